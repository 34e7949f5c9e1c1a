"""Optional behaviors of pedestrians, each declared in a file of its own, and the one table of them."""

from crowd_env.core.behaviors.balance import Balance
from crowd_env.core.behaviors.behavior import Behavior
from crowd_env.core.behaviors.drive import DriveLimit
from crowd_env.core.behaviors.headway import Headway
from crowd_env.core.behaviors.outline import Outline
from crowd_env.core.behaviors.pulls import Pulls

# Name, of a field of scenarios and settings -> behavior.
BEHAVIORS: dict[str, type[Behavior]] = {one.NAME: one for one in (Headway, Outline, DriveLimit, Balance, Pulls)}
