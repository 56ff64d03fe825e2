"""The compiled loop against the motor wrapper, which does a run from cycle to cycle in Python."""

from dataclasses import replace
from functools import partial
from threading import get_ident

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from butterfly.errors import InputError
from butterfly.logs.log import SAMPLED, Sine
from butterfly.model.parameters import AddedMass, Friction, Hand, TorqueDrive, VoltageDrive
from butterfly.plant.motor import LARGEST_COMMAND, CommandPath
from butterfly.plant.rig import Rig, Simulator
from butterfly.plant.robot import Clutch, Robot
from butterfly.plant.sensors import BandLimitedNoise, Clock, Encoder, Faults
from butterfly.signals.excitations import FreeDecay, Multisine, Prbs, Table
from tests.model.joints import some
from tests.plant.setting import ADDED, SINE, robot, simulated, wrapped

PLACES = {"com_distance": (-0.08, 0.08), "com_offset": (-0.02, 0.02), "tilt": (0, 0.5)}
HANDS = some(partial(Hand, mass=0.2, inertia=3e-3), **PLACES)
MOTOR = partial(VoltageDrive, resistance=2.0, torque_constant=0.05)
DRIVES = some(MOTOR, back_emf_constant=(0, 0.1), inductance=(1e-4, 2e-2))
DRIVES |= st.just(TorqueDrive(gain=0.03))
DRY = {"coulomb": (1e-5, 3e-3), "stribeck": (0, 1e-3)}
WAVY = {"bias": (-1e-3, 1e-3), "cogging": (-1e-3, 1e-3), "cogging_cosine": (-1e-3, 1e-3)}
FRICTIONS = some(Friction, **DRY, **WAVY, viscous=(0, 2e-3), load=(0, 1e-3), drag=(0, 1e-4))
BRISTLED = partial(Friction, coulomb=1e-3, bristle_stiffness=2.0)
FRICTIONS |= some(BRISTLED, stribeck=(0, 1e-3), bristle_damping=(0, 1e-3))
SIZES, RATES = st.floats(1e-3, 2), st.floats(0.5, 40)
EXCITATIONS = st.one_of(
    st.builds(Sine, omega=RATES, amplitude=SIZES),
    st.builds(Multisine, base=RATES, harmonics=st.just((1, 3, 4)), peak=SIZES),
    st.builds(Prbs, amplitude=SIZES, bit=st.floats(1e-3, 0.1), register=st.integers(2, 10)),
    st.builds(FreeDecay, angle=st.floats(-3, 3).filter(bool)),
)
PATHS = {"resolution": (1e-4, 0.1), "delay": (1e-5, 0.05), "dead_zone": (0, 0.1)}
PATHS |= {"compression": (0, 1)}
ENCODERS = st.builds(
    Encoder,
    steps=st.sampled_from([1000, 32768, 2**40]),
    noise=st.just(0.0) | st.floats(0, 1e-2),
    band_limited=st.none()
    | st.builds(BandLimitedNoise, power=st.floats(0, 1e-6), sample_time=st.floats(1e-3, 0.1)),
)


@st.composite
def clocks(draw):
    step = draw(st.sampled_from([1e-3, 2.5e-4, 0.01, 0.00123]) | st.floats(1e-4, 0.03))
    return Clock(step=step, jitter=draw(st.just(0.0) | st.floats(0, step / 2)))


SETUPS = st.builds(
    Rig,
    robot=st.builds(Robot, hand=HANDS, drive=DRIVES, friction=FRICTIONS),
    simulator=st.just(Simulator.GREY_BOX),
    clock=clocks(),
    encoder=ENCODERS,
    path=some(partial(CommandPath, limit=0.8), **PATHS),
    faults=some(Faults, dropped=(0, 0.2), duplicated=(0, 0.2)),
)

PLAIN = Rig(robot=robot(coulomb=3e-4), simulator=Simulator.GREY_BOX)


def _assert_same_bits(logs, others):
    for log, other in zip(logs, others, strict=True):
        for name in SAMPLED:
            assert getattr(log, name).tobytes() == getattr(other, name).tobytes(), name
        for name in ("input_kind", "intersample", "added_mass", "excitation", "source"):
            assert getattr(log, name) == getattr(other, name)


@settings(max_examples=25)
@given(
    rig=SETUPS,
    added=some(AddedMass, mass=(0, 0.2), arm=(0, 0.15)),
    excitation=EXCITATIONS,
    count=st.integers(40, 150),
)
def test_it_gives_the_wrapper_s_log_to_the_bit(rig, added, excitation, count):
    runs, duration = [(added, excitation), (AddedMass(), excitation)], count * rig.clock.step
    _assert_same_bits(simulated(rig, runs, duration), wrapped(rig, runs, duration))


def test_many_cycles_at_1_khz_are_the_wrapper_s_to_the_bit():
    """Long enough for the stamps to round, so that no two cycles are of quite the same length."""
    rig = replace(PLAIN, encoder=Encoder(noise=1e-4), path=CommandPath(delay=0.0023))
    runs = [(ADDED, Multisine(base=0.5, harmonics=(3, 5, 8, 13), peak=0.3))]
    _assert_same_bits(simulated(rig, runs, 17.0), wrapped(rig, runs, 17.0))


@pytest.mark.parametrize("jitter", [0.0, 2e-4])
def test_any_number_of_threads_gives_the_same_logs_but_it_takes_no_more_than_it_may(jitter):
    idents = set()

    class Noted(FreeDecay):
        def sample(self, time):
            idents.add(get_ident())
            return super().sample(time)

    runs = [(ADDED, Noted(angle=0.1 + 0.01 * k)) for k in range(20)]
    rig = replace(PLAIN, clock=Clock(jitter=jitter), encoder=Encoder(noise=1e-3))
    one = simulated(rig, runs, 0.5, threads=1)
    assert len(idents) == 1
    _assert_same_bits(one, simulated(rig, runs, 0.5, threads=3))


REFUSED = {
    "diverges": (replace(PLAIN, robot=robot(bias=1e6)), SINE),
    "starts beyond any angle": (PLAIN, FreeDecay(angle=1e6)),
    "command too large": (PLAIN, Table(time=(0.0, 0.05), values=(0.0, LARGEST_COMMAND))),
    "friction": (replace(PLAIN, robot=robot(load=-5e-3)), SINE),
    "clutch": (replace(PLAIN, robot=robot(clutch=Clutch(backlash=0.01, rotor_inertia=1e-3))), SINE),
}


@pytest.mark.parametrize(("rig", "excitation"), REFUSED.values(), ids=REFUSED)
def test_what_the_wrapper_refuses_is_refused_in_the_same_words(rig, excitation):
    errors = []
    for simulate in (simulated, wrapped):
        with pytest.raises(InputError) as caught:
            simulate(rig, [(ADDED, excitation)], 2.0)
        errors.append(str(caught.value))
    assert errors[0] == errors[1]
