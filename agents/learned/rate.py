"""How the learning rate falls."""


class FallingRate:
    """A learning rate that falls linearly to zero over the share of the budget that is spent, and never below zero.

    The budget is of steps and of time: what counts is the larger spent share.

    Attributes
    ----------
    time_spent : share of the time that has passed, as far as it counts; whoever watches over the training sets it.
    """

    def __init__(self, initial: float) -> None:
        self.initial, self.time_spent = initial, 0.0

    def __call__(self, steps_left: float) -> float:
        """Return the rate when this share of the steps is left; the last rollout goes beyond its budget."""
        return self.initial * max(0.0, min(steps_left, 1.0 - self.time_spent))
