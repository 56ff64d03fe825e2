import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import chirp, max_len_seq

from butterfly.errors import InputError
from butterfly.signals import excitations as ex

TIME = np.arange(0, 20, 1e-3)


def test_a_stepped_sine_keeps_its_phase_and_takes_each_frequency():
    sine = ex.SteppedSine(omegas=(2.0, 5.0, 9.0), amplitudes=(0.3, 0.3, 0.3), dwell=5.0)
    values = sine.sample(TIME)
    assert np.abs(np.diff(values)).max() < 0.3 * 9.0 * 1.01e-3
    np.testing.assert_allclose(values[:5000], 0.3 * np.sin(2 * TIME[:5000]), atol=1e-12)
    phase = 5 * 2.0 + 5 * 5.0
    late = TIME[10_000:]
    np.testing.assert_allclose(values[10_000:], 0.3 * np.sin(phase + 9 * (late - 10)), atol=1e-9)


@settings(max_examples=20)
@given(
    harmonics=st.sets(st.integers(1, 40), min_size=1, max_size=15),
    peak=st.floats(0.01, 10),
    seed=st.integers(0, 5),
)
def test_a_multisine_has_equal_lines_where_asked_and_nothing_elsewhere(harmonics, peak, seed):
    signal = ex.Multisine(base=0.5, harmonics=tuple(sorted(harmonics)), peak=peak, seed=seed)
    period = 2 * np.pi / 0.5
    values = signal.sample(np.arange(256) * period / 256)
    lines = np.abs(np.fft.rfft(values))
    present = sorted(harmonics)
    assert lines[present] == pytest.approx(lines[present[0]], rel=1e-6)
    assert np.delete(lines, present) == pytest.approx(0, abs=1e-9 * lines.max())
    assert np.abs(values).max() <= peak * 1.1


def test_a_multisine_is_the_same_sampled_at_once_or_in_pieces():
    signal = ex.Multisine(base=0.5, harmonics=(3, 5, 8, 13), peak=1.0)
    pieces = [signal.sample(part) for part in np.split(TIME, [1, 700, 5000])]
    np.testing.assert_array_equal(signal.sample(TIME), np.concatenate(pieces))


def test_the_crest_factor_is_optimised_below_that_of_random_phases_and_schroeder_s():
    count, lines = 31, tuple(range(1, 32))
    time = np.arange(4096) * 2 * np.pi / 4096
    schroeder = [-np.pi * k * (k - 1) / count for k in lines]
    rng = np.random.default_rng(0)

    def crest_of(values):
        return np.abs(values).max() / np.sqrt(np.mean(values**2))

    def crest(phases):
        return crest_of(np.cos(np.outer(time, lines) + phases).sum(axis=1))

    random = np.median([crest(rng.uniform(-np.pi, np.pi, count)) for _ in range(50)])
    found = crest_of(ex.Multisine(base=1.0, harmonics=lines, peak=1.0).sample(time))
    assert found < crest(schroeder) < random
    assert found < 1.6


def test_a_chirp_sweeps_and_then_stays_at_its_last_frequency_without_a_jump_in_phase():
    values = ex.Chirp(start=1.0, stop=10.0, duration=10.0, amplitude=0.4).sample(TIME)
    early, late = TIME[:10_000], TIME[10_000:]
    scipy = 0.4 * chirp(early, 1.0 / (2 * np.pi), 10.0, 10.0 / (2 * np.pi), phi=-90)
    np.testing.assert_allclose(values[:10_000], scipy, rtol=0, atol=1e-12)
    swept = 1.0 * 10 + 0.5 * (9 / 10) * 10**2
    np.testing.assert_allclose(values[10_000:], 0.4 * np.sin(swept + 10 * (late - 10)), atol=1e-9)
    assert np.abs(np.diff(values)).max() < 0.4 * 10.0 * 1.01e-3


@pytest.mark.parametrize("register", [2, 10, 20])
def test_a_prbs_holds_the_bits_of_scipy_s_register_again_and_again(register):
    expected = np.resize(max_len_seq(register)[0], 2**register + 7)
    prbs = ex.Prbs(amplitude=0.2, bit=0.05, register=register)
    found = prbs.sample((np.arange(expected.size) + 0.5) * 0.05)
    np.testing.assert_array_equal(found, np.where(expected, 0.2, -0.2))


def test_a_table_is_held_between_its_instants_and_zero_before():
    table = ex.Table(time=(1.0, 2.0, 4.0), values=(0.1, -0.2, 0.3))
    found = table.sample(np.array([0.0, 0.99, 1.0, 1.99, 2.0, 3.9, 4.0, 99.0]))
    assert found.tolist() == [0, 0, 0.1, 0.1, -0.2, -0.2, 0.3, 0.3]


def test_a_free_decay_starts_at_its_angle_without_input():
    decay = ex.FreeDecay(angle=0.7)
    assert ex.initial_angle(decay) == 0.7
    assert not decay.sample(TIME).any()


@pytest.mark.parametrize(
    "build",
    [
        lambda: ex.SteppedSine(omegas=(), amplitudes=(), dwell=1),
        lambda: ex.SteppedSine(omegas=(1,), amplitudes=(1, 2), dwell=1),
        lambda: ex.SteppedSine(omegas=(1,), amplitudes=(-1,), dwell=1),
        lambda: ex.Multisine(base=0, harmonics=(1,), peak=1),
        lambda: ex.Multisine(base=1, harmonics=(1, 1), peak=1),
        lambda: ex.Multisine(base=1, harmonics=(0,), peak=1),
        lambda: ex.Chirp(start=-1, stop=1, duration=1, amplitude=1),
        lambda: ex.Prbs(amplitude=1, bit=1, register=1),
        lambda: ex.FreeDecay(angle=0.0),
        lambda: ex.Table(time=(0, 0), values=(1, 1)),
        lambda: ex.Table(time=(0, 1), values=(1,)),
        lambda: ex.Table(time=(0, 1), values=(1, float("nan"))),
    ],
)
def test_impossible_excitations_are_refused(build):
    with pytest.raises(InputError):
        build()
