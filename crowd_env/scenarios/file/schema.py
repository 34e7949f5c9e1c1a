"""The JSON Schema of scenario files: editors complete keys and mark mistakes with it."""

from typing import Any

from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import CoreSchema, core_schema

from crowd_env.scenarios.file.tables import scenario_adapter

_IN_BRACES = r"^\{[^{}]*\}$"


class _WithExpressions(GenerateJsonSchema):
    """Lets an expression in braces stand for a number."""

    def float_schema(self, schema: core_schema.FloatSchema) -> dict[str, Any]:
        return {"type": ["number", "string"], "pattern": _IN_BRACES}

    def int_schema(self, schema: core_schema.IntSchema) -> dict[str, Any]:
        return {"type": ["integer", "string"], "pattern": _IN_BRACES}

    def field_title_should_be_set(self, schema: CoreSchema) -> bool:
        return False  # a key is its own title


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of scenario files, in draft 7, the newest that most editors of TOML read."""
    schema = scenario_adapter.json_schema(ref_template="#/definitions/{model}", schema_generator=_WithExpressions)
    definitions = schema.pop("$defs")
    return {"$schema": "http://json-schema.org/draft-07/schema#", **schema, "definitions": definitions}
