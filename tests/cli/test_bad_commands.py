"""Mistakes at the command line, one table: each is one sentence with exit code 2, prints no result and writes nothing."""

import os
import shlex

import pytest
from cases import looped
from command_files import BAD, BINARY, GOOD
from typer.testing import CliRunner

from crowd_env.cli.main import app

DOOR = "--exit 6,2,6,3"
OF_BOTH = ("evaluate", "train")
OF_TASKS = (*OF_BOTH, "submit --policy rule", "export rule --transitions runs.npz")

CASES = [
    # names, numbers and options
    ("run moon-v0", "unknown scenario 'moon-v0' room-v0 task of crowd-env list .wkt"),
    ("replay moon", "moon no such folder or file"),
    ("film moon", "moon no such folder or file"),
    ("forces moon", "moon no such folder or file"),
    ("run ''", "unknown scenario '' room-v0 .wkt"),
    ("plan '' --out out.png", "unknown scenario '' room-v0 .wkt"),
    ("show ''", "unknown task '' narrow-door"),
    ("evaluate --scenario ''", "unknown scenario '' room-v0 .wkt"),
    ("train --scenario ''", "unknown scenario '' room-v0 .wkt"),
    ("run narrow-door --seed 1000000 --runs 5", "--seed 1000000 0 to 999995 held out"),
    ("run narrow-door-v3 --seed 999996 --runs 5", "--seed 999996 0 to 999995 held out"),
    *((f"{command} --task room-v0", "unknown task 'room-v0' narrow-door is a scenario") for command in OF_TASKS),
    *((f"{command} --task good.toml", "unknown task 'good.toml' narrow-door") for command in OF_TASKS),
    *((f"{command} --scenario narrow-door", "unknown scenario 'narrow-door' is a task --task") for command in OF_BOTH),
    *((f"{command} --task room --scenario room-v0", "--task room --scenario room-v0 one") for command in OF_BOTH),
    ("run --scheme glue", "glue nsm2"),
    ("run --set social=glue", "glue"),
    ("run --scheme law.py", "--scheme law.py law.py:NAME"),
    ("run --policy mine.py", "--policies mine.py mine.py:NAME"),
    ("run --set balance=glue", "unknown balance 'glue' none stepping"),
    ("run --set balance=stepping --scheme nsm1", "nsm1 balance dem nsm2 hertz"),
    ("run --routing glue", "glue shortest"),
    ("run --runs 0", "runs 0 at least 1"),
    ("run --runs -3", "runs -3 at least 1"),
    ("run --people 900", "900 people do not fit"),
    ("run --people 400000", "400000 people do not fit at most"),
    ("run lin-room-v0 --people 1000000000", "1000000000 people do not fit"),
    ("run theatre-v0 --people 1000000000", "1000000000"),
    ("run floor-v0 --people 400000", "people do not fit 'south-offices'"),
    ("run floor-v0 --people 1", "1 person for cohorts at least 1"),
    ("run --set dt=1e-9", "decision_dt = 0.1 s 1e+08 physics steps 1e-09 100000"),
    ("run --set radius=wide", "--set radius=wide 0.2,0.25"),
    ("run --set radius=0.1,0.2,0.3", "--set 0.2,0.25"),
    ("run --set radius=0.3,0.2", "0.3 0.2 not be larger"),
    ("run --set response_time=lognormal,5", "--set response_time=lognormal,5 lognormal,median,sigma,high"),
    ("run --set response_time=normal,5,1,9,3", "--set response_time 9 3"),
    ("run --set radius=0", "radius > 0"),
    ("run --set radius=-0.2", "radius > 0"),
    ("run --set radius=nan", "nan"),
    ("run --set radius=inf", "inf finite"),
    ("run --set radius=1e-9", "radius 1e-09 larger bodies"),
    ("run --set radius=9", "do not fit"),
    ("run --set radius=0.6 --people 3", "door 0.82 m narrower 1.20 m"),
    ("run --set speed=-1", "speed [0, 12.5]"),
    ("run --set speed=inf", "inf finite"),
    ("run --set speed=,", "--set speed=,"),
    ("run --set dt=0", "dt > 0"),
    ("run --set dt=-1", "dt > 0"),
    ("run --set dt=nan", "dt > 0"),
    ("run --set dt=0.03", "0.03 whole number"),
    ("run --set dt=0.1 --scheme dem", "dem stable step"),
    ("run --time-limit 0", "time limit > 0"),
    ("run --time-limit nan", "time limit > 0"),
    ("run --time-limit inf", "time limit finite"),
    ("run --exit 5,2,5,3", "room-v0 --exit"),
    ("run --unit cm", "room-v0 meters --unit"),
    ("run good.toml --unit mm", "good.toml meters --unit"),
    ("run good.toml --exit 6,2,6,3", "good.toml --exit"),
    ("warmup --scheme glue", "glue nsm2"),
    # plans
    ("run none.wkt --exit 6,2,6,3", "none.wkt No such file"),
    (f"run . {DOOR}", "cannot read"),
    ("run plan.wkt", "plan.wkt at least one exit"),
    ("run plan.wkt --exit 5,2,5,3", "plan.wkt exit boundary 1 m"),
    ("run plan.wkt --exit 6,2,6", "plan.wkt 6,2,6 x1,y1,x2,y2"),
    ("run plan.wkt --exit 6,2,6,x", "plan.wkt x1,y1,x2,y2"),
    ("run plan.wkt --exit 6,2,6,nan", "exit '6,2,6,nan' finite"),
    ("run plan.wkt --exit inf,2,6,3", "exit 'inf,2,6,3' finite"),
    ("run plan.wkt --exit 6,2,6,2", "length 0 m 0.02"),
    ("run plan.wkt --exit 6,2,6,2.2", "0.20 m narrower 0.30 m"),
    *((f"{command} plan.wkt --exit door", "plan.wkt 'door' x1,y1,x2,y2") for command in ("run", "plan")),
    *((f"{command} plan.wkt --exit a,b,c,d", "plan.wkt 'a,b,c,d' x1,y1,x2,y2") for command in ("run", "plan")),
    ("run plan.wkt --exit 'POINT (6 2)'", "Point LINESTRING"),
    ("run plan.wkt --exit 'POLYGON ((8 0, 9 0, 9 1, 8 1, 8 0))'", "does not touch 2 m"),
    ("run plan.wkt --exit 'POLYGON ((-1 -1, 9 -1, 9 9, -1 9, -1 -1))'", "exits leave no walkable area"),
    ("run plan.wkt --exit 6,2,6,3 --exit 6,2.5,6,4", "overlap"),
    (f"run plan.wkt {DOOR} --people 900", "900 people do not fit"),
    (f"run plan.wkt {DOOR} --unit inch", "inch m, cm, mm"),
    (f"run plan.wkt {DOOR} --unit mm", "not on the boundary"),
    ("run mm.wkt --exit 6000,2000,6000,3000", "6000 m x 5000 m mm --unit"),
    ("run mm.wkt --exit 6000,2000,6000,3000 --people 500000", "mm --unit"),
    ("run huge.wkt --exit 600000,0,600000,100", "--unit mm"),
    ("run huge.wkt --exit 600000,0,600000,100 --unit m", "nodes meters"),
    ("run km.wkt --exit 0.006,0.002,0.006,0.004", "km degrees --unit"),
    (f"run nan.wkt {DOOR}", "nan.wkt finite"),
    (f"run inf.wkt {DOOR}", "inf.wkt finite"),
    (f"run empty.wkt {DOOR}", "empty.wkt WKT"),
    (f"run nothing.wkt {DOOR}", "no area"),
    (f"run point.wkt {DOOR}", "Point POLYGON"),
    (f"run points.wkt {DOOR}", "Point POLYGON"),
    ("run open.wkt --exit 0,1,0,2", "open.wkt closed"),
    ("run flat.wkt --exit 0,1,0,2", "flat.wkt no area"),
    ("run way.wkt --exit 0,1,0,2", "way.wkt LineString POLYGON"),
    ("run prose.wkt --exit 0,1,0,2", "prose.wkt WKT"),
    (f"run bow.wkt {DOOR}", "self-intersection (2.5, 2.5)"),
    (f"run curve.wkt {DOOR}", "CURVEPOLYGON straight"),
    (f"run degrees.wkt {DOOR}", "degrees 4326 meters"),
    (f"run mercator.wkt {DOOR}", "Mercator 3857 meters"),
    (f"run geo.wkt {DOOR}", "GeoJSON well-known text scenario"),
    (f"run geo.geojson {DOOR}", "geo.geojson no features"),
    (f"run plan.dxf {DOOR}", "plan.dxf DXF"),
    (f"run notes.dxf {DOOR}", "notes.dxf DXF"),
    (f"run plan.xml {DOOR}", "XML begins with geometry of JuPedSim"),
    (f"run plan.svg {DOOR}", "XML well-known text"),
    (f"run sqlite.wkt {DOOR}", "SQLite well-known text"),
    (f"run zip.wkt {DOOR}", "zip well-known text"),
    (f"run image.wkt {DOOR}", "PNG well-known text"),
    (f"run pdf.wkt {DOOR}", "PDF well-known text"),
    (f"run dwg.wkt {DOOR}", "DWG well-known text"),
    (f"run noise.wkt {DOOR}", "noise.wkt no text"),
    (f"run utf16.wkt {DOOR}", "utf16.wkt"),
    ("run many.wkt --exit 0,0.2,0,0.8 --people 20", "do not fit"),
    # recorded starts
    ("run --starts none.csv", "none.csv No such file"),
    ("run --starts .", "cannot read"),
    ("run --starts no_y.csv", "column 'y' missing 'z'"),
    ("run --starts twice.csv", "column 'x' twice"),
    ("run --starts headless.csv", "column 'x' missing '1'"),
    ("run --starts comma.csv", "row 1 4 cells 2 columns decimal comma"),
    ("run --starts thousand.csv", "person 1 1.000,5"),
    ("run --starts word.csv", "word.csv person 1 one"),
    ("run --starts under.csv", "person 1 1_0"),
    ("run --starts infinite.csv", "person 1 finite"),
    ("run --starts nan.csv", "nan.csv finite"),
    ("run --starts short.csv", "short.csv y"),
    ("run --starts bare.csv", "bare.csv no positions"),
    ("run --starts utf16.csv", "utf16.csv"),
    ("run --starts blank.csv", "no starting positions x,y"),
    ("run --starts header.csv", "no starting positions"),
    ("run --starts trajectory.csv", "trajectory frame one line"),
    ("run --starts far.csv", "start 1 (70, 1) outside"),
    ("run --starts near.csv", "starts 0 and 1 overlap smaller bodies"),
    ("run --starts wall.csv", "start 1 wall does not fit"),
    (f"run holed.wkt {DOOR} --starts hole.csv", "start 0 outside"),
    ("run --starts excel.csv", "zip Excel CSV"),
    ("run --starts old.csv", "Excel CSV"),
    ("run --starts latin.csv", "UTF-8"),
    ("run --starts near.csv --people 5", "--people 5 near.csv 2"),
    (f"run two.wkt {DOOR} --starts lost.csv", "start 0 (8.5, 1) part that no exit reaches"),
    # exit times
    ("clogging none.csv", "none.csv No such file"),
    ("clogging blank.csv", "blank.csv no exit times"),
    ("clogging exits.csv", "exits.csv no exit times"),
    ("clogging early.csv", "early.csv row 2 -0.5 >= 0"),
    ("clogging notime.csv", "notime.csv column 'time' is missing"),
    ("clogging never.csv", "never.csv row 2 nan finite"),
    ("clogging one.csv", "one.csv row 1 'one'"),
    ("clogging cell.csv", "cell.csv row 1 '' number"),
    ("clogging cells.csv", "cells.csv row 1 3 cells 2 columns decimal comma"),
    ("clogging yes.csv", "yes.csv out is 'yes'"),
    ("clogging stay.csv", "stay.csv row 2 second"),
    ("clogging late.csv", "late.csv run '1' after the last exit"),
    ("clogging json.csv", "JSON CSV"),
    ("clogging mixed.csv --pause 0", "pause > 0"),
    ("clogging mixed.csv --out good.toml", "good.toml not a folder"),
    # scenario files
    ("run missing.toml", "missing.toml No such file"),
    ("run crowd.toml", "crowd.toml 1000000000 people do not fit"),
    ("run digits.toml", "digits.toml people whole number"),
    ("run columns.toml", "columns.toml unknown columns"),
    ("run seats.toml", "seats.toml starts numbers"),
    ("run walls.toml", "walls.toml unknown line"),
    ("run words.toml", "().__class__ number"),
    ("run deep.json", "nested too deeply"),
    ("run deeper.json", "nested too deeply"),
    ("run deep.toml", "deep.toml unknown"),
    ("run outside.toml", "../secret.csv outside of the folder"),
    ("run absolute.toml", "/etc/passwd outside of the folder"),
    ("run rules.toml", "rules tuple"),
    ("run exits.toml", "exits tuple"),
    ("run zone.toml", "zone 'mat' changes nothing"),
    ("run door.toml", "door 'gate' touches no wall"),
    ("run short_door.toml", "gate 0.1 m"),
    ("run kilometers.toml", "200000 m nodes meters"),
    ("run closed.toml", "closed_doors tuple"),
    ("run radius.toml", "radius 1e-09 larger bodies"),
    ("run time.toml", "time_limit finite"),
    ("run apron.toml", "apron 50 [0, 10]"),
    ("run broken.toml", "broken.toml"),
    ("run broken.json", "broken.json"),
    ("run plan.toml", "plan.toml"),
    ("run noise.toml", "noise.toml"),
    ("run cohorts.toml --people 1", "1 person for 2 cohorts"),
    ("run start.toml", "region 'far' outside"),
    ("run cut.toml", "region 'cell' part that no exit reaches"),
    # pictures and folders
    ("run --record 1", "--record --out"),
    ("run --out good.toml", "good.toml not a folder"),
    ("plan room-v0 --out out.pdf", "out.pdf .png"),
    ("plan room-v0 --out folder.png", "folder.png folder"),
    ("plan room-v0 --out good.toml/out.png", "--out not a folder"),
    ("plan moon-v0", "moon-v0 room-v0"),
    ("plan crowd.toml", "1000000000 people do not fit"),
    ("plan columns.toml", "columns.toml unknown columns"),
    ("plan outside.toml", "outside of the folder"),
    # papers
    ("reproduce table9", "table9"),
    ("reproduce table5 --runs 0", "--runs 0 at least 1"),
    ("reproduce table5 --set people=1", "people 1 at least 3"),
    ("reproduce table5 --set people=1000000000", "1000000000 people do not fit"),
    ("reproduce table5 --set dt=nan", "dt finite"),
    ("reproduce table3 --set people=9", "people belongs to"),
    ("reproduce table5 --out good.toml", "good.toml not a folder"),
    ("reproduce lin-fig6 --workers 0", "--workers 0 at least 1"),
    ("reproduce table5 --set side=1e9", "nodes"),
    ("reproduce lin-fig5 --workers 2 --ray", "--workers 2 beside --ray"),
    ("reproduce table3 --ray", "--ray belongs to"),
]

USAGE = [
    "run --people 0",
    "run --people 2.5",
    "run --seed -1",
    "run --runs many",
    "run --dt",
    "fly",
    "run a b",
    "run --fly",
]
USAGE += ["clogging", "reproduce", "plan", "warmup --scheme", "run --unit"]

NOTES = [
    ("run --set speed=9 --time-limit 3", "--set speed=9 m/s walk 1.34"),
    ("run long.wkt --exit 320,0,320,2 --time-limit 450 --scheme dem", "320 m x 2 m cm --unit cm"),
    ("run wide.wkt --exit 25,0,25,22 --time-limit 450 --scheme dem", "exit 22 m wide cm --unit cm"),
    ("run two.wkt --exit 6,2,6,3", "no exit can be reached from a part of 10 m2 left out"),
    ("run shaft.wkt --exit 6,2,6,3", "no exit can be reached from a part of left out"),
    ("run gap.wkt --exit 8,2,8,3", "less than 1 cm apart are joined 1 mm"),
    ("run plan.wkt --exit 6.1,2,6.1,3", "0.10 m off the boundary moved"),
    ("run plan.wkt --exit 5.98,2,5.98,3", "0.02 m off the boundary moved"),
    ("run plan.wkt --exit 'POLYGON ((6.2 2, 7 2, 7 3, 6.2 3, 6.2 2))'", "0.20 m off the boundary moved"),
    ("run line.wkt --exit 6,2,6,3", "left out LineString"),
]
QUIET = [
    "run bom.wkt --exit 6,2,6,3",
    "run srid.wkt --exit 6,2,6,3",
    "run cm.wkt --exit 600,200,600,300 --unit cm",
    "run mm.wkt --exit 6000,2000,6000,3000 --unit mm",
    "run --starts excel_de.csv",
    "run --starts capitals.csv",
    "run --starts tabs.csv",
    "run long.wkt --exit 320,0,320,2 --time-limit 450 --scheme dem --unit m",
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("commands")
    (root / "secret.csv").write_text("password,x\nhush,1\n")
    place = root / "here"
    place.mkdir()
    for name, text in {**BAD, **GOOD}.items():
        (place / name).write_text(text, encoding="utf-8", newline="")
    for name, data in BINARY.items():
        (place / name).write_bytes(data)
    for name in ("folder.gif", "folder.png"):
        (place / name).mkdir()
    return place


def call(line, folder, monkeypatch):
    monkeypatch.chdir(folder)
    return CliRunner().invoke(app, shlex.split(line))


def tree(folder):
    return sorted((path, path.stat().st_size) for path in folder.parent.rglob("*"))


def refused(line, words, folder, monkeypatch):
    """Check that a mistake is one sentence, before anything is written."""
    before = tree(folder)
    result = call(line, folder, monkeypatch)
    assert result.exit_code == 2, f"{result.output} {result.exception!r}"
    assert isinstance(result.exception, SystemExit)
    assert result.stdout == "" and "hush" not in result.stderr
    said = result.stderr.splitlines()
    assert said[-1].startswith("error: ") and all(note.startswith("note: ") for note in said[:-1]), result.stderr
    assert len(said[-1]) < 600
    for word in words.split():
        assert word in said[-1], f"{word!r} is not in {said[-1]!r}"
    assert tree(folder) == before


@looped(("line", "words"), CASES[::8])
def test_a_mistake_is_one_sentence(line, words, folder, monkeypatch):
    refused(line, words, folder, monkeypatch)


@pytest.mark.more
@looped(("line", "words"), [case for k, case in enumerate(CASES) if k % 8])
def test_each_mistake_is_one_sentence(line, words, folder, monkeypatch):
    refused(line, words, folder, monkeypatch)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes with names")
@looped(
    "line",
    [
        *("run {}", "plan {}", "run room-v0 --people 5 --starts {}", "run --config {}", "clogging {}"),
        *(
            "evaluate --scenario {}",
            "train --scenario {}",
            "film {}.sqlite",
            "replay {}.h5",
            "run {}.dxf",
            "run {}.toml",
        ),
    ],
)
def test_a_pipe_or_a_device_is_no_file(line, folder, monkeypatch):
    """Whoever opened one would wait for ever, or read until there is no memory left."""
    suffix = line.partition("{}")[2]
    for name, make in (("pipe", os.mkfifo), ("zeros", lambda path: os.symlink("/dev/zero", path))):
        if not os.path.lexists(folder / f"{name}{suffix}"):
            make(folder / f"{name}{suffix}")
        result = call(line.format(name), folder, monkeypatch)
        assert (result.exit_code, result.stdout) == (2, ""), line
        assert (
            result.stderr
            == f"error: {name}{suffix} is no regular file but a device or a pipe; copy what it holds into a file\n"
        )


@looped("line", USAGE)
def test_a_malformed_command_is_a_usage_error(line, folder, monkeypatch):
    result = call(line, folder, monkeypatch)
    assert result.exit_code == 2 and result.stdout == "" and "Traceback" not in result.output
    assert "Error" in result.stderr


@pytest.mark.more
@looped(("line", "words"), NOTES)
def test_what_is_mended_is_said(line, words, folder, monkeypatch):
    runs = "" if "--times" in line else " --runs 1 --people 3"
    result = call(f"{line}{runs} --json", folder, monkeypatch)
    assert result.exit_code == 0, result.output
    (note,) = result.stderr.splitlines()
    assert note.startswith("note: ")
    for word in words.split():
        assert word in note, f"{word!r} is not in {note!r}"


@pytest.mark.more
@looped("line", QUIET)
def test_what_people_have_is_understood(line, folder, monkeypatch):
    count = "" if "--starts" in line or "--people" in line else " --people 3"
    result = call(f"{line} --runs 1{count} --json", folder, monkeypatch)
    assert result.exit_code == 0 and result.stderr == "", result.output
