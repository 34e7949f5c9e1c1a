"""The JSON Schema of scenario files: editors complete keys and mark mistakes with it.

It follows from the types of `Scenario` and its parts, with the notes beside their fields; reading a file needs none of it.
"""

from math import isfinite
from typing import Any

import numpy as np
from pydantic import ConfigDict, TypeAdapter
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import PydanticOmit, core_schema

from crowd_env.core.behaviors import BEHAVIORS
from crowd_env.core.checks import COUNT, POSITIVE, Plain
from crowd_env.geometry.geometry import Geometry
from crowd_env.scenarios.cohorts import Cohorts
from crowd_env.scenarios.distributions import LAWS, Distribution
from crowd_env.scenarios.file import OF_BUILDING, OLDER, House, Line, Plan
from crowd_env.scenarios.population import BOUNDS
from crowd_env.scenarios.scenario import Scenario

_Law = LAWS["uniform"] | LAWS["normal"] | LAWS["lognormal"]
# Class of Python -> its form in a file.
_IN_FILES: dict[type, Any] = {Geometry: Plan, Distribution: float | tuple[float, float] | _Law, np.ndarray: str | Line}
_CONFIG = ConfigDict(use_attribute_docstrings=True, arbitrary_types_allowed=True)


def _core(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind | None, config=_CONFIG)  # a dataclass alone takes no settings


class _InFiles(GenerateJsonSchema):
    """Shows classes as files hold them, and leaves out empty entries."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False

    def int_schema(self, schema: core_schema.IntSchema) -> JsonSchemaValue:
        return {**super().int_schema(schema), **COUNT.in_schema()}  # as `check_fields` has it

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        default = schema.get("default")
        nothing = default is None or (isinstance(default, float) and not isfinite(default))
        return self.generate_inner(schema["schema"]) if nothing else super().default_schema(schema)

    def is_instance_schema(self, schema: core_schema.IsInstanceSchema) -> JsonSchemaValue:
        return self.generate_inner(_core(_IN_FILES[schema["cls"]]).core_schema)

    def union_schema(self, schema: core_schema.UnionSchema) -> JsonSchemaValue:
        choices: Any = schema["choices"]
        for kind in choices:
            names = [*getattr(kind.get("cls"), "PRESETS", ())]  # of a behavior
            if names:
                return {"anyOf": [{"enum": names, "type": "string"}, self.generate_inner(kind)]}
        return super().union_schema(schema)

    def dataclass_schema(self, schema: core_schema.DataclassSchema) -> JsonSchemaValue:
        kind = schema["cls"]
        if kind is Cohorts:  # has a key of its own
            raise PydanticOmit
        if kind in _IN_FILES:
            return self.generate_inner(_core(_IN_FILES[kind]).core_schema)
        table = super().dataclass_schema(schema)
        table |= {"description": str(kind.__doc__).split("\n\n")[0], "additionalProperties": False}
        for name, law in LAWS.items():
            if kind is law:
                table["properties"] = {"distribution": {"const": name, "type": "string"}, **table["properties"]}
                table["required"] = ["distribution", *table["required"]]
        return table


def json_schema() -> Plain:
    """Return the JSON Schema of scenario files, in draft 7, the newest that most editors of TOML read."""
    scenario = _core(Scenario).json_schema(ref_template="#/definitions/{model}", schema_generator=_InFiles)
    house = _core(House).json_schema(ref_template="#/definitions/{model}", schema_generator=_InFiles)
    definitions = _draft_7({**scenario.pop("$defs"), **house.pop("$defs")})
    del definitions["Population"]["required"]  # recorded starts have a number; cohorts share the rest
    definitions["Plan"]["anyOf"] = [{"required": ["walkable", "exits"]}, {"required": ["file"]}]
    of_plan = definitions["Plan"]["properties"].items()  # with the notes beside the fields of this class
    definitions["Storey"]["properties"] |= {name: one for name, one in of_plan if name != "jamb_radius"}
    del definitions["Storey"]["properties"]["jamb_radius"]
    density = {"type": "number", **POSITIVE.in_schema(), "description": "1/m2, in place of the number of people."}
    definitions["Population"]["properties"]["density"] = density
    of_level = {"type": "string", "description": "name of the level of these coordinates, in a building"}
    for name in ("Population", "Section", "Attraction"):
        definitions[name]["properties"]["level"] = of_level
    entries = {"type": "string", "description": "CSV file of recorded entries, in place of all other keys: time, x, y."}
    definitions["Arrivals"]["properties"]["file"] = entries
    for name, allowed in BOUNDS.items():
        single, pair, *_ = definitions["Population"]["properties"][name]["anyOf"]
        for form in (single, pair["items"]):
            form |= allowed.in_schema()
    for name, behavior in BEHAVIORS.items():
        scenario["properties"][name]["description"] = behavior.ABOUT
    own = {
        "$schema": {"type": "string", "description": "JSON Schema of this file, for editors; not read"},
        "cohorts": {
            "type": "array",
            "items": {"$ref": "#/definitions/Population"},
            "description": "cohorts of people of different kinds",
        },
        **_draft_7(house["properties"]),
    }
    properties = {
        "": own,
        "population": definitions["Population"]["properties"],
        "pulls": definitions["Pulls"]["properties"],
    }
    for name, older in OLDER.items():
        for key, today in older.items():
            note = {"description": f"older word for {today}", "deprecated": True}
            properties[name][key] = {**properties[name][today], **note}
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        **scenario,
        "description": "A scenario of crowd_env. Lengths are in m, times in s, speeds in m/s, masses in kg.",
        "properties": scenario["properties"] | own,
        "required": [],
        "anyOf": [{"required": ["geometry"]}, {"required": [OF_BUILDING[0]]}],
        "definitions": definitions,
    }


def _draft_7(schema: Any) -> Any:
    """Return a part of a schema in draft 7, which has no ``prefixItems``."""
    if isinstance(schema, list):
        return [_draft_7(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    found = {"items" if key == "prefixItems" else key: _draft_7(one) for key, one in schema.items()}
    items = found.get("items")
    if isinstance(items, list) and items.count(items[0]) == len(items):  # the numbers of a point are of one kind
        found["items"] = items[0]
    return found
