"""Bodies of several discs: where their discs are, what these touch, and what turns the bodies into their way."""
