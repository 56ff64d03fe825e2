"""The page's JavaScript simulates a log as the compiled kernel does, on the same grid."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import butterfly.report
from butterfly.identification.free_run import Setting
from butterfly.identification.simulation import Simulation
from butterfly.logs.log import Log
from butterfly.model.parameters import AddedMass
from butterfly.report.live import Column, LiveLog
from butterfly.twin import c
from tests.programs import said
from tests.twin.compiled import GEAR, KINDS, drawn, needs_node

MODEL = Path(butterfly.report.__file__).parent / "templates/live_model.js"
DRIVER = """
(async () => {{
  const log = {log}, runs = [];
  [log.u, log.q] = await Promise.all([unpacked(log.commands), unpacked(log.measured)]);
  for (const moves of {moves}) {{
    const motion = simulated(log, moves);
    runs.push({{motion: [...motion], ...fitOf(log.q, motion)}});
  }}
  console.log(JSON.stringify({{measured: [...log.q], runs}}));
}})();
"""
EXACT = 1e-9  # rad
MORE = {"stribeck": {"load_friction": 0.05}}
"""What joints have beside that which they are drawn with."""


def _log_of(kind, noise=1e-3, seed=1):
    """A joint of a kind with a delay, and a log of it that it does not quite follow."""
    twin, step, commands = drawn(seed, kind)
    added = AddedMass() if kind == "slide" else AddedMass(mass=0.05, arm=0.1)
    parameters = replace(twin.parameters, **MORE.get(kind, {}))
    twin = replace(twin, parameters=parameters, added=added, limit=np.inf, resolution=0.0)
    delivered = np.asarray(parameters.delivered(commands))
    angle = c.held_motion(twin.loaded, np.zeros(64), delivered, (0.0, 0.0), step)[0][:-1]
    rng = np.random.default_rng(seed)
    time, seen = step * np.arange(commands.size), angle + noise * rng.normal(size=angle.size)
    log = Log(time, commands, 0.02 + seen, input_kind=twin.kind, added_mass=added)
    return twin, log


def _live(twin, log, reach=0.01, horizon=None):
    setting = Setting(parameters=twin.parameters, zero=0.02)
    simulation = setting.simulation(log)
    if horizon:
        simulation = Simulation(log, twin.parameters, horizon=horizon)
    return LiveLog.of(simulation, setting, 0.0, reach)


def _in_node(twin, live, moves, folder):
    """What the page computes for a log: the measured motion, and runs with moved parameters."""
    script = DRIVER.format(log=json.dumps(live.document()), moves=json.dumps(moves))
    text = "\n".join([c.as_javascript(twin), MODEL.read_text(encoding="utf-8"), script])
    (folder / "live.js").write_text(text, encoding="utf-8")
    return json.loads(said("node", folder / "live.js"))


def _is_the_same(twin, live, moves, folder):
    seen, bare = _in_node(twin, live, moves, folder), twin.parameters
    assert np.abs(np.subtract(seen["measured"], live.measured.values)).max() < EXACT
    found = []
    for each, run in zip(moves, seen["runs"], strict=True):
        moved = replace(bare, **{name: getattr(bare, name) + by for name, by in each.items()})
        ours = live.simulated(moved)
        assert np.abs(np.subtract(run["motion"], ours)).max() < EXACT
        assert run["fit"] == pytest.approx(live.fit(moved), abs=1e-6)
        error = np.sqrt(np.mean((ours - live.measured.values) ** 2))
        assert run["rms"] == pytest.approx(error, rel=1e-6)
        found.append(run["fit"])
    return found


@needs_node
@pytest.mark.parametrize("kind", KINDS)
def test_a_page_simulates_a_log_as_the_compiled_kernel(kind, tmp_path):
    twin, log = _log_of(kind)
    p = twin.parameters
    assert p.delay > 0
    moves = [{}, {"p1": 0.02 * p.p1}, {"p4": -0.03 * p.p4, "p2": 0.1 * p.p2, "delay": 0.0037}]
    moves += [{"delay": -0.6 * p.delay}, *({name: 0.1 * getattr(p, name)} for name in _terms(p))]
    first, *others = _is_the_same(twin, _live(twin, log), moves, tmp_path)
    assert first > 90
    assert all(abs(each - first) > 1e-6 for each in others)


def _terms(p):
    return [
        each for each in ("coulomb", "stribeck", "bias", "dead_zone", *GEAR) if getattr(p, each)
    ]


@needs_node
def test_every_segment_of_a_log_starts_where_its_free_run_does(tmp_path):
    twin, log = _log_of("stribeck")
    live = _live(twin, log, horizon=0.7)
    assert len(live.starts) > 3
    _is_the_same(twin, live, [{}, {"p3": 0.05}, {"delay": 0.0021}], tmp_path)


@needs_node
def test_a_log_of_velocities_is_simulated_in_velocities(tmp_path):
    twin, log = _log_of("slide", noise=0.0)
    velocity = np.gradient(log.angle, log.time)
    log = Log(time=log.time, input=log.input, velocity=velocity, input_kind=log.input_kind)
    live = _live(twin, log)
    assert live.document()["integrated"]
    assert _is_the_same(twin, live, [{}, {"p2": 0.001}], tmp_path)[0] > 80


@pytest.mark.parametrize("kind", ["smooth", "stribeck", "base and friction", "pulled"])
def test_on_the_grid_a_log_is_simulated_almost_as_its_free_run(kind):
    twin, log = _log_of(kind)
    live = _live(twin, log)
    run = live.setting.run(live.simulation)
    instants = log.time[0] + live.step * np.arange(live.measured.levels.size)
    ours = live.simulated(twin.parameters)
    assert np.abs(np.interp(instants, log.time, run.simulated) - ours).max() < 3e-3 * np.ptp(ours)
    assert live.fit(twin.parameters) == pytest.approx(run.fit, abs=0.3)


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=50))
def test_a_column_is_rounded_to_its_range_and_no_more(values):
    column = Column.of(np.array(values))
    assert np.abs(column.values - values).max() <= np.ptp(values) / 20_000
    assert column.values[0] == values[0]
