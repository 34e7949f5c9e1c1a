"""A deck that sways to the side under those who walk on it: one lateral mode, coupled to their steps."""
