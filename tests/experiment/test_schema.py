"""What an experiment file may say; what else it says is one error with file, field and value."""

import json

import numpy as np
import pytest
import yaml

from butterfly.errors import InputError, memory, require_room, size_text
from butterfly.experiment.schema import Experiment
from butterfly.experiment.source import read_experiment
from butterfly.experiment.sweep_spec import SweepSpec
from butterfly.files import is_name, shipped, shipped_experiments
from butterfly.logs.motors import motor_of
from butterfly.model.prior import Known, Prior
from tests.experiment.setting import QUICKSTART, SINGLE, planned, written


def _plant(part, **keys):
    return {"plant": {part: keys}}


def _masses(**keys):
    return {"added_masses": [{}, {"mass": 0.05, "arm": 0.104} | keys]}


def _grid(**fields):
    return {"sweep": {"grid": {name.replace("__", "."): value for name, value in fields.items()}}}


def _drawn(**distribution):
    return {"sweep": {"random": {"count": 2, "fields": {"duration": distribution}}}}


def _signal(**signal):
    return {"excitations": [], "signals": [signal]}


def _estimators(*estimators):
    return {"estimators": list(estimators)}


TWICE = [{"seed": 1}, {"duration": 30.0}]
LINEAR = {"method": "linear"}
WAVE = {"base": 1.0, "harmonics": [1, 2_000_000_000], "peak": 0.1}

SLIPS = [
    (_plant("hand", com_distance=1e155), "content: got numbers out of range"),
    (_masses(arm=1e155), "content: got numbers out of range"),
    (_masses(arm=0), r"added_masses\.\d\.arm: got 0; expected more than 0 m for"),
    (_plant("clock", step=1e5), "plant.clock.step: got 100000.0; expected at most 0.9375 s"),
    ({"duration": 1e155}, r"duration: got 1e\+155 s; expected less: it needs 6.4e"),
    ({"known": {"p4": 10**400}}, "known.p4: got 1000"),
    ({"known": {"p44": 1}}, r"known\.p44: got an unknown name; expected 'p4'"),
    ({"known": {"from": "xl33"}}, r"s\.yaml:4: known\.from: got xl33; expected 'xl330'"),
    ({"known": {"from": "ak80-6"}}, r"known\.from: got ak80-6 with input: voltage; expected"),
    (_plant("hand", mass=-0.1), r"s\.yaml:5: plant\.hand\.mass: got -0\.1; expected a finite pos"),
    (_plant("hand", mas=0.1), r"s\.yaml:6: plant\.hand\.mas: got an unknown key; expected 'mass'"),
    (_plant("hand", tilt=2.0), r"plant\.hand\.tilt: got 2\.0; expected an angle between -pi/2"),
    (_plant("drive", torque={"gain": 1}, voltage={}), r"plant\.drive\."),
    (_plant("clock", jitter=0.1), r"plant\.clock\.jitter: got 0\.1; expected from 0 to half"),
    (_plant("encoder", steps=0), r"plant\.encoder\.steps: got 0"),
    (_plant("encoder", steps=10**400), r"steps: got more; expected 1 to 1152921504606846976 steps"),
    (_plant("friction", drag=-1.0), r"plant\.friction\.drag: got -1\.0; expected a finite non-neg"),
    (_plant("friction", dreg=1.0), r"plant\.friction\.dreg: got an unknown key; expected 'drag'"),
    (_plant("clutch", backlash=0.1, rotor_inertia=1.0), r"rotor_inertia: got 1\.0"),
    (
        _plant("loop", law="pid-torque", kp=1),
        r"plant\.loop\.law: got pid-torque; expected a law with v",
    ),
    (_plant("loop", law="pid-voltage"), r"plant\.loop\.kp: got nothing"),
    (_plant("loop", law="pid"), r"loop\.law: got pid; expected"),
    ({"plant": {"supply": {"time": [0], "values": [7]}}}, r"plant\.supply: got .*a loop of duty"),
    ({"plant": {"torque_off": [[1, 2]]}}, r"plant\.torque_off: got .*a loop"),
    (_masses(mass=-0.1), r"added_masses\.1\.mass: got -0\.1; expected a finite non-negative"),
    (_masses(joint="slide"), r"added_masses: got 50 g on a slide under 0 m/s²"),
    (_masses(gravity=3.7), r"under 3\.7 m/s²; expected a mass on a hinge under 9\.81"),
    ({"added_masses": []}, r"added_masses: got \[\]"),
    ({"excitations": [{"omega": 0, "amplitude": 1}]}, r"excitations\.0\.omega: got 0"),
    ({"excitations": [{"omega": 1, "amplitude": "x"}]}, r"excitations\.0\.amplitude: got 'x'"),
    ({"excitatons": []}, r"excitatons: got an unknown key; expected 'excitations'"),
    ({"duration": float("inf")}, r"duration: got inf"),
    ({"duration": -3}, r"duration: got -3"),
    ({"duration": 1e12}, r"duration: got 1e\+12 s; expected less: it needs .* EB|PB"),
    ({"seed": -1}, r"seed: got -1"),
    ({"seed": 2**63}, r"seed: got"),
    ({"extends": "s.yaml"}, "extend this one"),
    ({"extends": "../elsewhere.yaml"}, "inside|same folder"),
    ({"extends": "/etc/passwd"}, "inside|same folder"),
    ({"extends": 3}, "the path of an experiment file"),
    ({"extends": "nowhere.yaml"}, "no such file"),
    ({"sweep": {"grd": {}}}, r"s\.yaml:5: sweep\.grd: got an unknown key; expected 'grid'"),
    (_grid(plant__hand__mass=[]), r"sweep\.grid\.plant\.hand\.mass"),
    (_grid(plant__hand__mass=[-1.0]), r"s\.yaml:6: plant\.hand\.mass: got -1\.0"),
    (_grid(plant__hnd__mass=[1.0]), r"s\.yaml:6: plant\.hnd: got an unknown key"),
    ({"sweep": {"list": [{"seed": 1}, {"seed": -1}]}}, r"s\.yaml:7: seed: got -1"),
    (_grid(added_masses__7__mass=[1.0]), "a number from 0 to 2"),
    (_grid(seed__x=[1.0]), "the path of a field"),
    (_grid(sweep__repetitions=[1]), "a field of the experiment"),
    ({"sweep": {"repetitions": 0}}, r"sweep\.repetitions: got 0"),
    (
        {"sweep": {"grid": {"duration": [20.0]}, "list": TWICE}},
        r"s\.yaml:4: sweep\.duration: got already set by duration; expected each field in only",
    ),
    (
        {"sweep": {"grid": {"plant.hand.mass": [0.1]}, "list": [{"plant.hand": {}}]}},
        r"sweep\.plant\.hand: got already set by plant\.hand\.mass",
    ),
    (_drawn(uniform=[2, 1]), "lower < upper"),
    (_drawn(log_uniform=[0, 1]), "must be positive"),
    (_drawn(normal=[1, 0]), "a positive standard"),
    ({"method": "magic"}, r"method: got 'magic'; expected 'harmonic-balance'"),
    ({"method": "linear", "terms": ["drag"]}, "terms: got drag; expected no terms"),
    ({"terms": ["drg"]}, r"s\.yaml:4: terms: got drg; expected 'drag'"),
    (LINEAR | _estimators(LINEAR), "either estimators"),
    (_estimators(LINEAR, LINEAR), "the same name"),
    (_estimators("linear"), r"estimators\.0: got 'linear'"),
    (
        _estimators(LINEAR | {"terms": ["drag"]}),
        r"s\.yaml:5: estimators\.0\.terms: got an unknown option; expected no option",
    ),
    (
        _estimators({"method": "output-error", "per_masss": ["zero"]}),
        r"per_masss: got an unknown option; expected 'per_mass'",
    ),
    (_estimators({"method": "output-error", "terms": ["x"]}), "terms: got x"),
    (_estimators({"method": "magic"}), r"estimators\.0\.method: got magic; expected one of 'harm"),
    (_signal(chirp={}, prbs={}), r"signals\.0\.chirp\.start, stop, duration, .*: got nothing"),
    (_signal(), r"signals\.0: got {}; expected exactly one of the keys stepped_sine"),
    (_signal(file={"path": "nowhere.csv"}), r"nowhere\.csv: path: got no such file"),
    (_signal(file={"path": "../../x.csv"}), "a path inside"),
    (_signal(prbs={"amplitude": 1, "bit": 0.1, "register": 99}), r"signals\.0\.prbs\.register"),
    (_signal(multisine=WAVE), r"harmonics: got 2000000000; expected less: it needs 1\.3 TB of mem"),
    ({"excitations": []}, "at least one of excitations, signals and control.believed"),
    *(({"name": name}, "name: got") for name in ("a/../b", "..", "...", "nul", "COM1.yaml")),
    ({"name": "x" * 101}, "a valid folder name of up to 100 characters"),
    *((_signal(file={"path": path}), "expected a path") for path in ("a\0b.csv", "a" * 5000)),
    *(({"extends": path}, "expected a path") for path in ("a\0b.csv", "a" * 5000)),
]


@pytest.mark.parametrize(("changes", "message"), SLIPS)
def test_a_slip_is_one_error_with_file_and_field(tmp_path, changes, message):
    path = written(tmp_path / "s.yaml", **QUICKSTART | changes)
    with pytest.raises(InputError, match=message) as caught:
        planned(path)
    assert str(tmp_path) in str(caught.value) or {"sweep", "extends"} & set(changes)


def test_known_values_may_be_those_of_a_motor_of_the_library(tmp_path):
    known = {"from": "xl330", "p4": 9.0}
    experiment = read_experiment(written(tmp_path / "s.yaml", **QUICKSTART | {"known": known}))
    values = Prior.of(experiment.known).values
    assert values["p4"] == Known(value=9.0)
    assert values["p2"] == motor_of("xl330").known["p2"].known("xl330")
    plain = experiment.model_dump(mode="json", exclude_unset=True)["known"]
    again = read_experiment(written(tmp_path / "again.yaml", **QUICKSTART | {"known": plain}))
    assert again.known == experiment.known


LUMPED = {"p1": 3e-3, "p2": 1, "p3": 0.05, "p4": 1}


@pytest.mark.parametrize(
    ("plant", "message"),
    [
        ({}, "hand and drive, or lumped"),
        ({"lumped": LUMPED, "friction": {}}, "either lumped or"),
        ({"lumped": LUMPED | {"delay": 0.1}}, "under path"),
        ({"lumped": LUMPED | {"loop_kp": 0.9}}, "gains under loop"),
        ({"lumped": LUMPED | {"p1": 0.0}}, "p1: got 0"),
    ],
)
def test_a_plant_that_cannot_be_is_refused(tmp_path, plant, message):
    with pytest.raises(InputError, match=message):
        read_experiment(written(tmp_path / "l.yaml", **SINGLE | {"plant": plant}))


def test_a_slip_in_another_file_is_blamed_on_it(tmp_path):
    written(tmp_path / "base.yaml", extends="quickstart", name="b", duration=-1.0)
    with pytest.raises(InputError, match=r"base\.yaml:3: duration"):
        read_experiment(written(tmp_path / "child.yaml", extends="base.yaml", name="c"))
    (tmp_path / "u.csv").write_text("time,input\n0,1\n2,1\n1,1\n")
    signals = {"signals": [{"file": {"path": "u.csv"}}]}
    with pytest.raises(InputError, match=r"u\.csv: time: got instants out of order"):
        read_experiment(written(tmp_path / "p.yaml", **SINGLE | signals))


def test_what_no_machine_holds_is_refused_with_its_bytes():
    require_room("test", "size", 1, memory())
    with pytest.raises(InputError, match="it needs inf EB of memory"):
        require_room("test", "size", 1, float("inf"))
    assert [size_text(size) for size in (17, 1.5e3, 2.4e12)] == ["17 bytes", "1.5 kB", "2.4 TB"]
    sweep = SweepSpec(grid={"seed": list(range(1000))}, repetitions=10**9)
    with pytest.raises(InputError, match=r"got 1,000,000,000,000 runs; expected less: it needs 2"):
        next(iter(sweep.points(0)))
    assert not any(is_name(name) for name in ("..", "nul", "COM1.yaml", "x" * 101))


def test_what_extends_is_changed_key_by_key_and_kinds_are_replaced(tmp_path):
    plant = {"drive": {"torque": {"gain": 2.0}}, "friction": {"drag": 1e-4}}
    path = written(tmp_path / "e.yaml", extends="quickstart", name="e", plant=plant)
    experiment = read_experiment(path)
    assert experiment.plant.drive.chosen.gain == 2.0
    assert (experiment.plant.friction.drag, experiment.plant.friction.coulomb) == (1e-4, 3e-4)
    child = written(tmp_path / "f.yaml", extends="e.yaml", name="f", seed=9)
    assert read_experiment(child).plant == experiment.plant


def test_every_shipped_experiment_is_read_and_the_schema_for_editors_covers_it(butterfly, tmp_path):
    code, out, _ = butterfly("schema")
    properties = json.loads(out)["properties"]
    parts = json.loads(out)["$defs"]
    for part in ("Hand", "VoltageDrive", "TorqueDrive", "Friction"):
        keys = {"viscous"} if part == "Friction" else set(parts[part]["properties"])
        assert {
            each for each in keys if "description" not in parts[part]["properties"][each]
        } == set()
    assert (code, "list" in json.dumps(SweepSpec.model_json_schema())) == (0, True)
    for name in shipped_experiments():
        content = yaml.safe_load(shipped(name).read_text())
        if "logs" not in content:
            assert planned(shipped(name)).tasks
            assert set(content) <= set(properties)
    assert butterfly("schema", "manifest", "--out", tmp_path / "m.json")[0] == 0
    assert "logs" in json.loads((tmp_path / "m.json").read_text())["properties"]


def test_sines_that_will_swing_wide_are_found_beforehand(tmp_path):
    sines = [{"omega": 3.9, "amplitude": 0.5}, {"omega": 20, "amplitude": 0.1}]
    wide = read_experiment(written(tmp_path / "s.yaml", **QUICKSTART, excitations=sines))
    (run,) = [run for run in wide.wide_swings() if run[0].mass == 0]
    assert run[1].omega == 3.9
    assert run[2] > 1.0
    assert read_experiment("quickstart").wide_swings() == []


def test_the_orbit_and_the_runs_draw_different_numbers_and_the_runs_those_they_always_drew():
    masses = [{"mass": 0.01 * k, "arm": 0.1} for k in range(30)]
    experiment = Experiment.model_validate(SINGLE | {"seed": 7, "added_masses": masses})
    seeds = [*experiment.seeds(), experiment.orbit_seed]
    drawn = [tuple(seed.generate_state(4)) for seed in seeds]
    always = [tuple(s.generate_state(4)) for s in np.random.SeedSequence(7).spawn(30)]
    assert drawn[:30] == always
    assert len(set(drawn)) == 31
