"""A deck that sways to the side under pedestrians: one lateral mode, coupled to their steps."""
