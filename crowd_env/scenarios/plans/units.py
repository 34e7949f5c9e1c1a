"""The unit of the coordinates of a plan: the user's has priority, the file's counts only if it is plausible."""

from crowd_env.core.checks import known
from crowd_env.scenarios.plans.floor_plan import RoleError

_METERS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254}

# A plan larger than this is rare, and one in centimeters always is: a note asks for the unit ...
_WIDE_EXIT, _LARGE = 20.0, 300.0  # m
# ... and beyond this no plan is accepted.
_WIDEST_EXIT, _LARGEST = 200.0, 3000.0  # m
_SMALL = 1.0  # m
_DOOR = (0.6, 3.0)  # m; nearly all doors are as wide
_DELIBERATE = (0.1, 0.99)  # m; feet, yards and decimeters


def unit_in_meters(unit: str | None) -> float:
    """Return how many meters a unit of length is; None = the meter.

    Raises
    ------
    ValueError
        If it is unknown.
    """
    return 1.0 if unit is None else _METERS[known("unit", unit, _METERS)]


def judge_unit(
    bounds: tuple[float, float, float, float], widest: float, said: str | None = None, meters: float | None = None
) -> tuple[float, str]:
    """Return how many meters a unit of a drawing is, without a unit of the user, and a note about it ("" = none).

    It is the meter, if a building can be so large.  Drawings often name the unit of a template, and are drawn in another.  So
    the file's unit counts only if meters are implausible and that unit is not.  Feet, yards and decimeters are in no template:
    they count unless the exits are as wide as doors in meters and not in them.

    Parameters
    ----------
    bounds : min x, min y, max x, max y of the plan, in units of the drawing.
    widest : length of the longest exit that is a line, in units of the drawing; 0 without one.
    said : the unit that the file names, if any.
    meters : how many meters that is, if it is known.

    Raises
    ------
    ValueError
        If no building has such a size.
    """
    width, height = bounds[2] - bounds[0], bounds[3] - bounds[1]
    across = max(width, height)
    file_says = "" if said is None or meters == 1.0 else f"; the file says that it is in {said}"
    usual = _SMALL <= across <= _LARGE and widest <= _WIDE_EXIT
    if meters is not None and _DELIBERATE[0] <= meters <= _DELIBERATE[1]:
        as_meters, as_said = (_DOOR[0] <= scale * widest <= _DOOR[1] for scale in (1.0, meters))
        usual = as_meters and not as_said
    if file_says and meters is not None and not usual:
        size = f"{meters * width:.4g} m x {meters * height:.4g} m"
        if _SMALL <= meters * across <= _LARGEST and meters * widest <= _WIDEST_EXIT:
            return meters, f"taken as {said}, as the file says: the plan is {size}; --unit m if it is in meters"
    seen = f"taken as meters, the plan is {width:.4g} m x {height:.4g} m"
    seen += f" and an exit {widest:.4g} m wide" if widest > _WIDE_EXIT else ""
    huge = across > _LARGEST or widest > _WIDEST_EXIT
    if huge or across < _SMALL:
        ask = f"is it in {'mm or cm' if huge else 'km or degrees'}? It must be in m, cm, mm, ft or in"
        raise RoleError(f"{seen}{file_says}: {ask}", "--unit mm if it is in mm, --unit m if it is in meters")
    if across > _LARGE or widest > _WIDE_EXIT:
        return 1.0, f"{seen}{file_says}: is it in cm? Then say --unit cm; --unit m if it is in meters"
    if file_says:
        return 1.0, f"{seen}{file_says}; --unit m, cm, mm, ft or in decides"
    return 1.0, ""
