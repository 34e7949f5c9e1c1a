"""What is known about crowds, one file a case and one line each in `CASES`."""

from validation.cases import gate, halls, jambs
from validation.cases.case import Case

CASES: dict[str, Case] = {
    "gate": gate.CASE,
    "halls": halls.HALLS_CASE,
    "great-halls": halls.GREAT_HALLS_CASE,
    "jambs": jambs.CASE,
}
