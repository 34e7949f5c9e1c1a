"""The tables of docs/reproduce.md: figures of the reports in their cells, and what is said of them follows from them."""

import pytest
from lin_runs import made_of, stuck

from crowd_env.reproduce import PAPERS
from crowd_env.reproduce.pecol2011.evacuations import PRINTED as FLOWS
from crowd_env.reproduce.pecol2011.theatre import IMPLIED, PRINTED
from validation.pages import Sources
from validation.reproduced import TABLES, clearance, flows, lin, theatre, variants


@pytest.fixture
def source():
    """Return what comes of a figure of Lin, Ma, Lo, made of ten invented runs of each configuration."""
    return Sources(reported)


def reported(line, **outcome):
    paper, name = PAPERS["lin"], line.removeprefix("crowd_env reproduce ")
    return made_of(paper.figures[name], paper.settings_of(name, {}), **outcome).as_json()


def test_clearance_times_and_blocked_draws_by_speed(source):
    of_200, of_300 = clearance(source)
    assert of_200[0] == "200 people (`lin-fig7`)" and of_200[3] == "249" and of_200[7] == "248 b5"
    assert of_300[-1] == "" and len(of_200) == len(of_300) == len(TABLES["clearance"][0])


def test_flows_by_speed(source):
    cells = flows(source)
    assert [row[0] for row in cells] == ["100 people", "200 people", "300 people"]
    assert cells[0][3] == "0.80" and cells[0][7].endswith(" b5")
    assert {len(row) for row in cells} == {len(TABLES["flows"][0])}


def test_what_the_paper_prints_stands_beside_what_comes_out(source):
    cells = {(row[0], row[1]): row[3:] for row in lin(source)}
    assert cells["4", "100 people, 1 m/s, A = 200 N"] == ["174 s, b0", "yes"]
    assert cells["5", "2 m/s, rotation on, off"] == ["124 s, b5; 124 s, b5", "NOT reproduced"]
    assert cells["7", "1.8, 2.0, 2.2 m/s"] == ["b5, b5, b5", "yes (fitted)"]
    assert {len(row) for row in lin(source)} == {len(TABLES["lin"][0])}


def test_nothing_out_is_no_number():
    source = Sources(lambda line: reported(line, outcome=stuck))
    assert clearance(source)[0][1:] == ["b10"] * 9 and flows(source)[0][1:] == ["– b10"] * 8
    cells = {(row[0], row[1]): row[3:] for row in lin(source)}
    assert cells["4", "A = 300 N"] == ["b10", "NOT reproduced"]
    assert cells["10", "fastest above 1.6 m/s"] == ["–; 60 of 60 draws blocked", "NOT reproduced"]


def test_other_readings_of_the_room_are_other_commands():
    asked = []

    def source(line):
        asked.append(line)
        rows = {f"flow, {scheme}, per run": 2.5 for scheme in FLOWS} | {f"unfinished, {scheme}": 3 for scheme in FLOWS}
        rows["draws with nsm1 > dem > nsm2-printed"] = None
        return {"rows": [{"quantity": name, "here": value} for name, value in rows.items()]}

    cells = variants(Sources(source))
    assert cells[0] == ["(none)", "2.50", "2.50", "2.50", "2.50", "–", "3/3/3/3"]
    assert (
        asked[0] == "crowd_env reproduce table5"
        and asked[1].endswith("table5 --set door_width=0.78")
        and len(cells) == len(asked) + 1
    )


def test_the_theatre_marks_what_is_far_from_the_exercise():
    here = {name: float(values[0]) * (1.2 if name == "last, B" else 1.0) for name, values in PRINTED.items()}
    here |= {name: 42.04 for name in IMPLIED}
    rows = []
    for name, value in here.items():
        rows += [(name, value, None), (f"{name}, no rules", value - 1.0, None)]
        rows.append((f"{name}: rules change it by", -1.0, [-1.5, -0.5]))
    keys = ("quantity", "here", "ci95")
    cells = theatre(Sources(lambda line: {"rows": [dict(zip(keys, row, strict=True)) for row in rows]}))
    assert cells[0] == ["A, last, s", "45", "49.4", "45.0", "44.0", "−1.00 (−1.50 to −0.50)"]
    assert cells[2][3] == "**79.2**" and cells[-1][3:] == ["42.0 / 42.0", "41.0 / 41.0", "−1.00 / −1.00"]
