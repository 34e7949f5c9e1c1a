"""The JSON Schema of scenario files and the table of keys in the documents say what the tables of the code say."""

import json
import re
from dataclasses import fields

import pytest
from repository import ROOT
from typer.testing import CliRunner

from crowd_env import SCENARIOS, Population, make_scenario
from crowd_env.cli.main import app
from crowd_env.scenarios.file.reading import tomllib
from crowd_env.scenarios.file.schema import json_schema

SHIPPED = SCENARIOS["floor-v0"].path.with_name("scenario.schema.json")


def test_the_schema_that_ships_is_the_one_that_the_command_writes(tmp_path):
    out = tmp_path / "new.json"
    assert CliRunner().invoke(app, ["schema", "--out", str(out)]).exit_code == 0
    assert out.read_text(encoding="utf-8") == SHIPPED.read_text(encoding="utf-8"), f"crowd-env schema --out {SHIPPED}"
    assert json.loads(CliRunner().invoke(app, ["schema"]).stdout) == json.loads(out.read_text()) == json_schema()
    wrong = CliRunner().invoke(app, ["schema", "--out", "schema.toml"])
    assert wrong.exit_code == 2 and "must end in .json" in wrong.stderr


def tables(schema):
    """Return name -> table of the schema, that of the whole file as ""."""
    return {"": schema, **{name: one for name, one in schema["definitions"].items() if "properties" in one}}


def test_every_key_has_a_note_and_no_table_takes_others():
    for name, table in tables(json_schema()).items():
        assert table["additionalProperties"] is False
        for key, one in table["properties"].items():
            inner = one.get("$ref", "").removeprefix("#/definitions/")
            told = one.get("description") or json_schema()["definitions"].get(inner, {}).get("description")
            assert told or (name, key) == ("Option", "default") or "const" in one, f"{name}.{key} has no note"


def test_people_have_the_keys_of_a_population():
    properties = json_schema()["definitions"]["People"]["properties"]
    assert list(properties) == [field.name for field in fields(Population)]


def test_numbers_may_be_expressions_but_not_in_options():
    schema = json_schema()
    length = schema["properties"]["time_limit"]
    assert length["type"] == ["number", "string"]
    assert re.match(length["pattern"], "{width / 2}") and not re.match(length["pattern"], "width")
    assert schema["definitions"]["Option"]["properties"]["default"]["type"] == "number"


def accepts(schema, value, whole):
    """Return whether a value is valid: as much of JSON Schema as this one uses."""
    if "$ref" in schema:
        return accepts(whole["definitions"][schema["$ref"].removeprefix("#/definitions/")], value, whole)
    if "oneOf" in schema and sum(accepts(one, value, whole) for one in schema["oneOf"]) != 1:
        return False
    if value != schema.get("const", value) or value not in schema.get("enum", [value]):
        return False
    if isinstance(value, str) and not re.search(schema.get("pattern", ""), value):
        return False
    kinds = {"object": dict, "array": list, "string": str, "boolean": bool, "number": (int, float), "integer": int}
    wanted = schema.get("type", [])
    wanted = [wanted] if isinstance(wanted, str) else wanted
    if wanted and not any(isinstance(value, kinds[one]) for one in wanted):
        return False
    if isinstance(value, list):
        size = schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value))
        return size and all(accepts(schema.get("items", {}), one, whole) for one in value)
    if isinstance(value, dict):
        properties, others = schema.get("properties", {}), schema.get("additionalProperties", True)
        if not set(schema.get("required", ())) <= set(value) or (others is False and not set(value) <= set(properties)):
            return False
        others = others if isinstance(others, dict) else {}
        return all(accepts(properties.get(key, others), one, whole) for key, one in value.items())
    return True


FILES = sorted(SHIPPED.parent.glob("*.toml"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_schema_takes_what_ships_and_refuses_what_the_reader_refuses(path):
    schema, content = json_schema(), tomllib.loads(path.read_text(encoding="utf-8"))
    assert accepts(schema, content, schema)
    for wrong in ({"titel": "x"}, {"target": "paht"}, {"geometry": {}}, {"comfort": {"stars": 1}}, {"name": 3}):
        assert not accepts(schema, {**content, **wrong}, schema)


def test_a_file_may_name_its_schema(tmp_path):
    content = {
        "$schema": "scenario.schema.json",
        "geometry": {"walkable": {"box": [0, 0, 5, 5]}, "exits": {"door": [[5, 2], [5, 3]]}},
        "population": {"people": 3},
    }
    (tmp_path / "a.json").write_text(json.dumps(content))
    assert make_scenario(tmp_path / "a.json").population.people == 3


# --------------------------------------------------------------------------------------------------------- documents


def key_rows():
    text = (ROOT / "docs" / "scenarios.md").read_text(encoding="utf-8")
    _, _, rest = text.partition("| key | what it holds |\n|---|---|\n")
    rows = re.findall(r"^\| (.*?) \| (.*) \|$", rest.partition("\n\n")[0], re.MULTILINE)
    return [(re.findall(r"`([^`]+)`", keys), note) for keys, note in rows]


def test_the_table_of_keys_in_the_documents_is_complete():
    schema = json_schema()
    definitions = schema["definitions"]
    geometry = [f"geometry.{key}" for key in definitions["Plan"]["properties"]]
    known = [key for key in schema["properties"] if key not in ("$schema", "geometry")] + geometry
    assert sorted(key for keys, _ in key_rows() for key in keys) == sorted(known)


@pytest.mark.parametrize(
    ("key", "table"),
    [
        ("population", "People"),
        ("routes", "Route"),
        ("zones", "SpeedZone"),
        ("rules", "ControlRule"),
        ("door_events", "DoorEvent"),
        ("one_way", "OneWay"),
        ("comfort", "Comfort"),
        ("options", "Option"),
    ],
)
def test_the_documents_name_every_key_of_a_table(key, table):
    (note,) = (note for keys, note in key_rows() if key in keys)
    named = set(re.findall(r"\w+", " ".join(re.findall(r"`([^`]+)`", note))))
    properties = set(json_schema()["definitions"][table]["properties"])
    assert properties <= named, f"{key}: the documents do not name {sorted(properties - named)}"
