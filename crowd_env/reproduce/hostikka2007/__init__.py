"""A recorded evacuation of an office stair, after Hostikka et al. 2007."""
