"""Bodies of several discs: places and contacts of the discs, and torques that turn bodies into their way."""
