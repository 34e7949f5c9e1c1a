"""Optional behaviors of pedestrians, each declared in its own file, and their table."""

from crowd_env.core.behaviors.balance import Balance
from crowd_env.core.behaviors.behavior import Behavior, Words
from crowd_env.core.behaviors.drive import DriveLimit
from crowd_env.core.behaviors.headway import Headway
from crowd_env.core.behaviors.outline import Outline
from crowd_env.core.behaviors.pulls import Pulls

# Name of a field of scenarios and settings -> behavior.
BEHAVIORS: dict[str, type[Behavior]] = {one.NAME: one for one in (Headway, Outline, DriveLimit, Balance, Pulls)}
# Name -> words of titles, tables and reports, for the behaviors that have any.
IN_WORDS: dict[str, Words] = {name: one.WORDS for name, one in BEHAVIORS.items() if one.WORDS is not None}
