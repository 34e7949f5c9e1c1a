"""What is known about crowds, one file a case and one line each in `CASES`."""

from validation.cases import frozen, gate, halls
from validation.cases.case import Case

CASES: dict[str, Case] = {
    "frozen": frozen.CASE,
    "gate": gate.CASE,
    "halls": halls.HALLS_CASE,
    "great-halls": halls.GREAT_HALLS_CASE,
}
