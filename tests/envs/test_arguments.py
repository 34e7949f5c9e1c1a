"""Whatever makes no sense is refused where it is given, by one sentence that names the argument and the value."""

from dataclasses import replace

import numpy as np
from cases import looped
from refusals import (
    INF,
    NAN,
    NO_CHOICE,
    NO_FLAG,
    NO_NAMES,
    NO_OBJECT,
    NO_TEXT,
    numeric,
    refuses,
    rows,
    table,
)

from crowd_env import (
    DEM,
    NSM1,
    NSM2,
    Cohorts,
    Comfort,
    ControlRule,
    DoorEvent,
    Geometry,
    Hertz,
    LogNormal,
    Normal,
    ObservationLayout,
    OneWay,
    Population,
    RewardWeights,
    Route,
    Scenario,
    SocialForce,
    SpeedZone,
    Uniform,
    make_bodies,
    make_scenario,
    make_scheme,
    read_starts,
)

ROOM = Geometry.from_polygon([(0, 0), (5, 0), (5, 5), (0, 5)], exits={"e": [(5, 2), (5, 3)]})
NORMAL = {"mean": 1.0, "sd": 1.0, "low": 0.0, "high": 2.0}
LOG_NORMAL = {"median": 1.0, "sigma": 1.0, "high": 2.0}
NO_PARTS = ("e", 3, {"a": 1}, None, ["a"], Route("r"))
LAWS = ("radius", "mass", "desired_speed", "relaxation_time", "response_time")


def scenario(**options):
    return Scenario(**{"name": "s", "geometry": ROOM, "population": Population(3), "time_limit": 60.0, **options})


def of(make, name, *given):
    """Return the call that gives one argument to a constructor, after those that have to be."""
    return lambda value: make(*given, **{name: value})


DISTRIBUTIONS = [
    *numeric("Uniform.low", lambda x: Uniform(x, 2.0), "finite"),
    *numeric("Uniform.high", lambda x: Uniform(1.0, x), "finite"),
    *[row for k in ("mean", "sd", "low", "high")
      for row in numeric(f"Normal.{k}", lambda x, k=k: Normal(**{**NORMAL, k: x}), "finite")],
    *[row for k in ("median", "sigma", "low", "high")
      for row in numeric(f"LogNormal.{k}", lambda x, k=k: LogNormal(**{**LOG_NORMAL, k: x}), "finite")],
    ("Uniform upside down", lambda: Uniform(2.0, 1.0), ("from 2 to 1", "must not be larger")),
    ("Normal sd<0", lambda: Normal(1.0, -1.0, 0.0, 2.0), ("sd is -1", "it must be >= 0")),
]  # fmt: skip

POPULATION = [
    *numeric("Population.people", lambda x: Population(x), "count"),
    *rows("Population.people", lambda x: Population(x), (10**9, 500_001)),
    *[row for name in LAWS for row in rows(f"Population.{name}", of(Population, name, 3), (
        None, "0.2", True, NAN, INF, 1j, Uniform, [0.2], (0.1, 0.2, 0.3), {}, np.array([0.2, 0.25]), -1.0, (-1.0, 2.0)))],
    *[(f"Population.{name}=0", lambda name=name: Population(3, **{name: 0}), (name, words, "as low as 0"))
      for name, words in (("radius", "> 0"), ("mass", "above 0"), ("relaxation_time", "> 0"))],
    ("Population.mass=1e12", lambda: Population(3, mass=1e12), ("mass", "at most 1000", "1e+12")),
    ("Population.response_time=1e9", lambda: Population(3, response_time=1e9), ("[0, 86400]", "1e+09")),
    ("Population.radius law", lambda: Population(3, radius={"distribution": "gamma"}), ("radius", "gamma", "lognormal")),
    ("Population.radius key", lambda: Population(3, radius={"distribution": "normal", "mu": 1}), ("radius", "key 'mu'")),
    ("Population.radius law lacks", lambda: Population(3, radius={"distribution": "normal"}), ("radius", "'mean' is missing")),
    *rows("Population.start_region", of(Population, "start_region", 3), NO_TEXT),
    *rows("Population.route", of(Population, "route", 3), NO_TEXT),
    *rows("Population.name", of(Population, "name", 3), (*NO_TEXT, None)),
    *rows("Population.exits", of(Population, "exits", 3), NO_NAMES),
    *rows("Population.starts", of(Population, "starts", 2), ("a.csv", {}, [[1j, 1j], [2j, 1]])),
    ("Population.starts=3", lambda: Population(2, starts=3), ("starts", "shape")),
    ("Population.starts and region", lambda: Population(1, starts=[[1.0, 1.0]], start_region="r"), ("not both",)),
    ("Population.route and exits", lambda: Population(1, route="r", exits=("e",)), ("not both",)),
    *rows("Cohorts.parts", Cohorts, (Population(3), Population, "ab", 3, {}, None)),
    ("Cohorts.parts of something", lambda: Cohorts((Population(3), "x")), ("parts[1]", "'x'", "Population")),
    ("Cohorts of none", lambda: Cohorts(()), ("at least one cohort",)),
    ("Cohorts of too many", lambda: Cohorts((Population(300_000), Population(300_000))), ("600000",)),
    *numeric("Cohorts.changed.people", lambda x: Cohorts((Population(3),)).changed(people=x), "count", or_none=True),
    *rows("Cohorts.changed.radius", lambda x: Cohorts((Population(3),)).changed(radius=x), ("0.2", Uniform, -1.0)),
]  # fmt: skip

ROUTES = [
    *rows("Route.name", Route, NO_TEXT),
    ("Route without a name", lambda: Route(""), ("needs a name",)),
    *rows("Route.exits", of(Route, "exits", "r"), NO_NAMES),
    *rows("Route.via", of(Route, "via", "r"), (3, b"x", 2.0, True)),
    *rows("Route.strategy", of(Route, "strategy", "r"), NO_CHOICE),
    *[(f"SpeedZone({value!r})", lambda value=value: SpeedZone(value, 1.0), ("region", repr(value)[:20])) for value in NO_TEXT],
    ("SpeedZone that does nothing", lambda: SpeedZone("r"), ("'r'", "changes nothing", "speed or a factor")),
    *numeric("SpeedZone.speed", of(SpeedZone, "speed", "r"), "bounded", or_none=True)[:-1],
    *numeric("SpeedZone.factor", of(SpeedZone, "factor", "r"), "bounded")[:-1],
    ("SpeedZone.factor=1e6", lambda: SpeedZone("r", factor=1e6), ("factor", "1000000", "at most 10")),
    *rows("ControlRule.region", lambda x: ControlRule(x, 1, "r"), (*NO_TEXT, None)),
    *numeric("ControlRule.at_least", lambda x: ControlRule("a", x, "r"), "count"),
    *rows("ControlRule.route", lambda x: ControlRule("a", 1, x), (*NO_TEXT, None)),
    *numeric("ControlRule.below", of(ControlRule, "below", "a", 5, "r"), "whole", or_none=True),
    *numeric("ControlRule.hold", of(ControlRule, "hold", "a", 5, "r"), "not negative"),
    *rows("ControlRule.commits", of(ControlRule, "commits", "a", 5, "r"), NO_FLAG),
    *[row for name, kind in (("stairs", "not negative"), ("turn", "not negative"), ("reach", "positive"))
      for row in numeric(f"Comfort.{name}", of(Comfort, name), kind)],
    *rows("DoorEvent.door", lambda x: DoorEvent(x, True, at=1.0), (*NO_TEXT, None)),
    *rows("DoorEvent.opens", lambda x: DoorEvent("d", x, at=1.0), NO_FLAG),
    *numeric("DoorEvent.at", of(DoorEvent, "at", "d", True), "not negative", or_none=True),
    *numeric("DoorEvent.at_least", lambda x: DoorEvent("d", True, at_least=x, exit="e"), "count", or_none=True),
    *rows("DoorEvent.region", lambda x: DoorEvent("d", True, at_least=1, region=x), NO_TEXT),
    *rows("DoorEvent.exit", lambda x: DoorEvent("d", True, at_least=1, exit=x), NO_TEXT),
    *rows("OneWay.door", lambda x: OneWay(x, "left"), (*NO_TEXT, None)),
    *rows("OneWay.to", lambda x: OneWay("d", x), NO_CHOICE),
]  # fmt: skip

SCENARIO = [
    *rows("Scenario.name", lambda x: scenario(name=x), (*NO_TEXT, None)),
    *rows("Scenario.geometry", lambda x: scenario(geometry=x), (*NO_OBJECT, None, Geometry)),
    *rows("Scenario.population", lambda x: scenario(population=x), (*NO_OBJECT, None, 20, [])),
    *numeric("Scenario.time_limit", lambda x: scenario(time_limit=x), "positive"),
    *numeric("Scenario.blocked_after", lambda x: scenario(blocked_after=x), "positive or infinite"),
    *rows("Scenario.target", lambda x: scenario(target=x), NO_CHOICE),
    *rows("Scenario.title", lambda x: scenario(title=x), (*NO_TEXT, None)),
    *[row for name in ("routes", "zones", "rules", "door_events", "one_way")
      for row in rows(f"Scenario.{name}", lambda x, name=name: scenario(**{name: x}), NO_PARTS)],
    *rows("Scenario.closed_doors", lambda x: scenario(closed_doors=x), NO_NAMES),
    *rows("Scenario.comfort", lambda x: scenario(comfort=x), ([], "flat", 3, Comfort, None, {"stars": 1})),
    ("Scenario without exits", lambda: scenario(geometry=Geometry.from_polygon([(0, 0), (5, 0), (5, 5)])), ("no exit",)),
    *rows("Scenario.route_set.strategy", lambda x: scenario().route_set(x), NO_CHOICE),
    *rows("Scenario.route_set.rules", lambda x: scenario().route_set(rules=x), NO_FLAG),
    *rows("read_starts the file", read_starts, (None, 3, b"x", ["a.csv"], Scenario)),
    ("read_starts no file", lambda: read_starts("nowhere.csv"), ("nowhere.csv",)),
    *rows("floor plan: the file", lambda x: make_scenario(x, exits=["5,2,5,3"]), (None, 3, b"x", ["a"])),
    *rows("floor plan: exits", lambda x: make_scenario("nowhere.wkt", exits=x), NO_NAMES),
    *rows("floor plan: unit", lambda x: make_scenario("a.wkt", exits=["5,2,5,3"], unit=x), NO_CHOICE),
    ("floor plan: no file", lambda: make_scenario("nowhere.wkt", exits=["5,2,5,3"]), ("nowhere.wkt",)),
    *rows("make_scenario.scenario", make_scenario, (None, 7, 1.5, ["room-v0"], Scenario, b"room-v0")),
    ("make_scenario nowhere", lambda: make_scenario("nowhere"), ("'nowhere'", "room-v0")),
    ("make_scenario no file", lambda: make_scenario("nowhere.toml"), ("nowhere.toml",)),
    ("make_scenario option", lambda: make_scenario("room-v0", sides=3), ("'sides'", "side")),
    *numeric("room.side", of(make_scenario, "side", "room-v0"), "positive"),
    *numeric("room.door_width", of(make_scenario, "door_width", "room-v0"), "bounded"),
    *numeric("room.people", of(make_scenario, "people", "room-v0"), "count", or_none=True),
    *numeric("room.time_limit", of(make_scenario, "time_limit", "room-v0"), "positive", or_none=True),
    *rows("room.population", of(make_scenario, "population", "room-v0"), ("20", 20, Population)),
    *[row for name in ("side", "door_width", "desired_speed")
      for row in rows(f"lin-room.{name}", of(make_scenario, name, "lin-room-v0"), (NAN, -1.0, "1", None, True))],
    *rows("lin-room.exit_depth", of(make_scenario, "exit_depth", "lin-room-v0"), (NAN, -1.0, 6.0, "1", None, True)),
    *rows("theatre.hold", of(make_scenario, "hold", "theatre-v0"), (NAN, -1.0, "1", None)),
    *rows("theatre.crowded", of(make_scenario, "crowded", "theatre-v0"), (5, "5,5,15", (5, 5), (5, 5, "15"))),
    *rows("theatre.commits", of(make_scenario, "commits", "theatre-v0"), NO_FLAG),
    *rows("theatre.people", of(make_scenario, "people", "theatre-v0"), (0, 2.5, "3", None, 10_000)),
    *rows("theatre.stair_speed", of(make_scenario, "stair_speed", "theatre-v0"), (0.0, NAN, "1", None)),
    *rows("pillar.people", of(make_scenario, "people", "pillar-v0"), (0, 2.5, "3", True, NAN)),
]  # fmt: skip

LEARNING = [
    *rows("ObservationLayout.terms", ObservationLayout, (*NO_NAMES, None)),
    ("ObservationLayout.terms unknown", lambda: ObservationLayout(("smell",)), ("'smell'", "velocity", "neighbors")),
    ("ObservationLayout.terms none", lambda: ObservationLayout(()), ("at least one",)),
    ("ObservationLayout.terms twice", lambda: ObservationLayout(("push", "push")), ("only once",)),
    *numeric("ObservationLayout.neighbors", of(ObservationLayout, "neighbors"), "1 to 32"),
    *numeric("ObservationLayout.rays", of(ObservationLayout, "rays"), "1 to 360"),
    *rows("RewardWeights.weights", RewardWeights, (["time"], "time", 3, None, ("time", 1.0))),
    ("RewardWeights unknown", lambda: RewardWeights({"joy": 1.0}), ("'joy'", "progress, exit, time, contact")),
    *numeric("RewardWeights.team_share", of(RewardWeights, "team_share"), "share"),
    *numeric("RewardWeights of time", lambda x: RewardWeights({"time": x}), "finite"),
]  # fmt: skip

PHYSICS = [
    *[row for name, kind in (("strength", "not negative"), ("wall_strength", "not negative"), ("length", "positive"),
                             ("cutoff", "positive"), ("anisotropy", "finite"))
      for row in numeric(f"SocialForce.{name}", of(SocialForce, name), kind)],
    *rows("SocialForce.helbing.behind", lambda x: SocialForce.helbing(behind=x), (1.1, -0.1, NAN, "0", None)),
    *rows("SocialForce.helbing.length", lambda x: SocialForce.helbing(length=x), (0.0, -0.1, NAN, "0", None)),
    *numeric("DEM.stiffness", DEM, "positive"),
    *[row for make in (NSM1, NSM2) for row in numeric(f"{make.__name__}.tolerance", of(make, "tolerance"), "positive")],
    *[row for make in (NSM1, NSM2)
      for row in numeric(f"{make.__name__}.relative_tolerance", of(make, "relative_tolerance"), "positive", or_none=True)],
    *numeric("NSM1.max_iterations", of(NSM1, "max_iterations"), "count"),
    *rows("NSM2.max_iterations", of(NSM2, "max_iterations"), (NAN, 0, -1, "3", None, True)),
    *rows("NSM1.trial", of(NSM1, "trial"), NO_CHOICE),
    *rows("NSM2.reaction", of(NSM2, "reaction"), NO_CHOICE),
    *rows("NSM2.normal_dissipation", of(NSM2, "normal_dissipation"), (NAN, -1.0, "1", None, True)),
    *rows("NSM2.tangential_dissipation", of(NSM2, "tangential_dissipation"), (NAN, -1.0, "1", None, True)),
    *numeric("Hertz.youngs_modulus", of(Hertz, "youngs_modulus"), "positive"),
    *[row for name in ("normal_damping", "tangential_damping", "friction", "wall_friction")
      for row in rows(f"Hertz.{name}", of(Hertz, name), (NAN, -1.0, "1", None, True))],
    *rows("Hertz.damping_unit", of(Hertz, "damping_unit"), NO_CHOICE),
    *[row for make in (DEM, NSM1, NSM2, Hertz)
      for row in rows(f"{make.__name__}.social", of(make, "social"), ("lim", 3, SocialForce))],
    ("NSM2.social key", lambda: NSM2(social={"stregth": 1.0}), ("'stregth'", "strength")),
    *rows("NSM2.max_iterations", of(NSM2, "max_iterations"), (2.5,)),
    *rows("Hertz.rotation", of(Hertz, "rotation"), NO_FLAG),
    *rows("make_scheme.scheme", make_scheme, (None, 3, NSM2, ["nsm2"], b"nsm2", ...)),
    ("make_scheme unknown", lambda: make_scheme("nsm3"), ("'nsm3'", "nsm2", "hertz")),
    ("make_scheme table", lambda: make_scheme({"tolerance": 1e-3}), ("contact scheme None", "nsm2")),
    ("make_scheme table key", lambda: make_scheme({"name": "dem", "stiff": 1}), ("unknown key 'stiff'", "stiffness")),
    ("make_scheme table value", lambda: make_scheme({"name": "nsm2", "tolerance": "1"}), ("tolerance", "'1'")),
    *rows("make_scheme.social", lambda x: make_scheme("nsm2", x), (3, ["lin"], SocialForce, b"lin")),
    ("make_scheme social key", lambda: make_scheme("nsm2", {"stregth": 1.0}), ("'stregth'", "strength")),
]  # fmt: skip

# Sentences that say more than the argument, its value and its bounds.
SENTENCES = {
    "normal distribution with mean 5: the mean must lie in [0, 2]": lambda: Normal(5.0, 1.0, 0.0, 2.0),
    "normal distribution: only ": lambda: Normal(3.0, 1.0, 3.0, 3.0001),
    "log-normal distribution: only ": lambda: LogNormal(3.0, 1.0, 3.0001, low=3.0),
    "log-normal distribution: median is 0.0; it must be > 0": lambda: LogNormal(0.0, 1.0, 5.0),
    "log-normal distribution: sigma is -1.0; it must be >= 0": lambda: LogNormal(3.0, -1.0, 5.0),
    "lie in [0, 5]": lambda: LogNormal(6.0, 1.0, 5.0),
    "population: desired_speed must be in [0, 12.5], but can be as low as -0.5": lambda: Population(
        3, desired_speed=(-0.5, 1)
    ),
    "population: response_time must be in [0, 86400], but can be as low as -1": lambda: Population(
        3, response_time=(-1, 1)
    ),
    "exits is 'e'; it must be a tuple of names: ('e',)": lambda: Population(3, exits="e"),
    "starts must have the shape (2, 2), not (2, 3), or more rows": lambda: Population(2, starts=np.zeros((2, 3))),
    "starts must have the shape (2, 2), not (1, 2), or more rows": lambda: Population(2, starts=[[1, 1]]),
    "starts must be numbers, one (x, y) [m] a row: ": lambda: Population(2, starts=[["a", 1], [2, 2]]),
    "numbers, one (x, y) [m] a row: ": lambda: Population(2, starts=[[1.0, 2.0], [1.0]]),
    "start 1 is [1.0, nan]; it must be finite": lambda: Population(2, starts=[[1, 1], [1, NAN]]),
    "route 'a': unknown strategy 'quick'; known: shortest, fastest, comfor": lambda: Route("a", strategy="quick"),
    "speed zone 'a': speed is 0.0; it must be above 0 and at most 12.5": lambda: SpeedZone("a", 0.0),
    "speed zone 'a': factor is -1.0; it must be above 0 and at most 10": lambda: SpeedZone("a", factor=-1.0),
    "control rule on 'a': at_least is 0; it must be at least 1": lambda: ControlRule("a", 0, "b"),
    "below is 4; it must be from 0 to at_least, 3": lambda: ControlRule("a", 3, "b", below=4),
    "event of door 'd': give either a time `at`, or `at_least` with one of `region` and": lambda: DoorEvent("d", True),
    "give either a time": lambda: DoorEvent("d", True, at=1.0, at_least=3, exit="e"),
    "`at_least` with one of": lambda: DoorEvent("d", True, at_least=3, exit="e", region="r"),
    "event of door 'd': at is -1.0; it must be >= 0 and finite": lambda: DoorEvent("d", True, at=-1.0),
    "dem: stiffness is 0.0; it must be > 0 and finite: the contact force k |D| (eq 5)": lambda: DEM(stiffness=0.0),
    "dem: stiffness is nan; it must be > 0": lambda: DEM(stiffness=NAN),
    "nsm1: tolerance is 0.0; it must be > 0": lambda: NSM1(tolerance=0.0),
    "nsm1: unknown trial 'eager'; known: spontaneous, inertial": lambda: NSM1(trial="eager"),
    "nsm2: normal_dissipation is -1.0; it must be >= 0": lambda: NSM2(normal_dissipation=-1.0),
    "K_N - 2 m_e": lambda: NSM2(normal_dissipation=-2.0),
    "nsm2: tangential_dissipation is -1.0; it must be >= 0": lambda: NSM2(tangential_dissipation=-1.0),
    "nsm2: position_correction is 1.5; it must be in [0, 1]": lambda: NSM2(position_correction=1.5),
    "nsm2: unknown reaction 'kind'; known: dissipative, printed": lambda: NSM2(reaction="kind"),
    "crowded is (5, 5); it must be three numbers of people": lambda: make_scenario("theatre-v0", crowded=(5, 5)),
    "crowded[0] is 0; it must be at least 1": lambda: make_scenario("theatre-v0", crowded=(0, 5, 15)),
    "hertz: youngs_modulus is 0.0; it must be > 0 and finite: k_n": lambda: Hertz(youngs_modulus=0.0),
    "hertz: poisson_ratio is 0.7; it must be above -1 and at most 0.5": lambda: Hertz(poisson_ratio=0.7),
    "hertz: unknown damping_unit 'N'; known: rate per length, rate, critical": lambda: Hertz(damping_unit="N"),
    "social force: anisotropy is 1.5; it must be in [-1, 1]": lambda: SocialForce(anisotropy=1.5),
    "anisotropy is -1.1; it must be in [-1, 1]": lambda: SocialForce(anisotropy=-1.1),
    "social force: behind (Lambda) is 2.0; it must be in [0, 1]": lambda: SocialForce.helbing(behind=2.0),
    "unknown social force 'lim'; known: none, helbing, lin": lambda: make_scheme("nsm2", "lim"),
    "radius of pedestrian 0 is 0; it must be finite and > 0": lambda: make_bodies([0.0], 80.0),
    "radius of pedestrian 1 is -0.2": lambda: make_bodies([0.2, -0.2], 80.0),
    "mass of pedestrian 0 is -1": lambda: make_bodies([0.2], -1.0),
    "mass of pedestrian 0 is nan": lambda: make_bodies([0.2], NAN),
    "relaxation_time of pedestrian 0 is 0": lambda: make_bodies([0.2], 80.0, relaxation_time=0.0),
    "speed of pedestrian 0 is -0.1; it must be finite and >= 0": lambda: make_bodies([0.2], 80.0, desired_speed=-0.1),
    "response_time of pedestrian 0 is inf": lambda: make_bodies([0.2], 80.0, response_time=INF),
}


@table(
    DISTRIBUTIONS,
    POPULATION,
    ROUTES,
    SCENARIO,
    LEARNING,
    PHYSICS,
    [(say, call, (say,)) for say, call in SENTENCES.items()],
)
def test_what_makes_no_sense_is_refused_in_one_sentence(call, words):
    refuses(call, words)


NUMBERS = [
    lambda x: Uniform(x(1), x(2)), lambda x: Population(x(3)).people, lambda x: Population(3, radius=x(1)).radius,
    lambda x: SpeedZone("r", x(1)), lambda x: ControlRule("a", x(5), "r", x(3), x(2)), lambda x: Comfort(x(1), x(2), x(3)),
    lambda x: DoorEvent("d", np.bool_(x(1) > 0), x(1)), lambda x: scenario(time_limit=x(9)).time_limit,
    lambda x: ObservationLayout(neighbors=x(3), rays=x(4)), lambda x: RewardWeights({"time": x(1)}),
    lambda x: SocialForce(x(1)), lambda x: make_scheme(NSM2(max_iterations=x(5), tolerance=x(1))),
    lambda x: make_scenario("room-v0", side=x(6), people=x(4)).population.people,
]  # fmt: skip


@looped("call", NUMBERS)
@looped("kind", [float, np.float64, np.float32, np.int64, np.int32, np.uint8])
def test_numbers_of_numpy_and_whole_floats_are_numbers(call, kind):
    assert repr(call(kind)) == repr(call(int))  # and become Python's: what is computed from them is the same


def test_plain_data_do_where_scenario_files_take_them():
    people = Population(30, radius=0.2, mass=(60, 80), desired_speed=[1, 2], response_time={
        "distribution": "lognormal", "median": 3, "sigma": 0.5, "high": 20})  # fmt: skip
    assert people.radius == Uniform(0.2, 0.2) and people.mass == Uniform(60.0, 80.0)
    assert people.desired_speed == Uniform(1.0, 2.0) and people.response_time == LogNormal(3.0, 0.5, 20.0)
    assert Cohorts([people, people]).changed(radius=0.25).radius == (0.25, 0.25)
    assert people.changed(mass=70).mass == Uniform(70.0, 70.0)
    assert make_scheme({"name": "nsm2"}) == make_scheme("nsm2")
    base = make_scheme("nsm2")
    assert make_scheme({"name": "nsm2", "tolerance": 1e-3}) == replace(base, tolerance=1e-3)
    assert (
        make_scheme({"name": "nsm2", "social": "lin"})
        == make_scheme("nsm2", "lin")
        == replace(base, social=SocialForce())
    )
    assert (
        make_scheme("dem", {"strength": 100})
        == DEM(social=SocialForce(100.0))
        == make_scheme(DEM(), SocialForce(100.0))
    )
    assert NSM2(social="lin") == NSM2(social={}) == NSM2(social=SocialForce()) != NSM2(social="none") == NSM2()
    assert make_scheme("hertz", "none") == Hertz(social=None) == make_scheme({"name": "hertz", "social": None})
    assert Route("r", ["a", "b"]).exits == ("a", "b")


def test_a_factor_of_one_may_be_given():
    assert SpeedZone("r", factor=1.0).factor == 1.0 == SpeedZone("r", 0.5).factor
    assert replace(SpeedZone("r", 0.5), region="s") == SpeedZone("s", 0.5)


def test_what_is_changed_after_it_was_given_changes_nothing():
    weights, starts = {"time": 1.0}, np.array([[1.0, 2.0], [3.0, 4.0]]).T
    reward, people = RewardWeights(weights), Population(2, starts=starts)
    weights["exit"], starts[0, 0] = 2.0, 9.0
    assert reward.weights == {"time": 1.0} and people.starts[0, 0] == 1.0 and people.starts.flags.c_contiguous
