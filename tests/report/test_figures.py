"""What all figures share: the samples that are drawn, and a colour for each mass."""

import json

import numpy as np

from butterfly.report.figures import grams, mass_looks, packable, seen_samples
from tests.report.setting import assert_seen, unpacked


def test_a_long_curve_keeps_its_peaks_when_it_is_thinned():
    rng = np.random.default_rng(0)
    curves = [rng.normal(size=100_000), np.cumsum(rng.normal(size=100_000))]
    some = seen_samples(curves, 1000)
    assert some.size <= 1002
    assert np.all(np.diff(some) > 0)
    for curve in curves:
        assert curve[some].max() == curve.max()
        assert curve[some].min() == curve.min()
    assert seen_samples(curves, 1000, every=200).tolist() == list(range(0, 100_000, 200))


def test_one_added_mass_has_one_colour_in_all_figures_of_a_page(simulated):
    result = simulated[0]
    looks = mass_looks(reversed(result.data.masses))
    for figure in (result.plot.fits(), result.plot.frequency_response()):
        for mass, (colour, _) in looks.items():
            own = [t for t in figure.data if (t.name or "").split(",")[0] == grams(mass)]
            assert {t.line.color or t.marker.color for t in own} == {colour}


def test_what_is_no_number_is_packed_as_none():
    for values in ([0.5, np.nan, -0.25, np.inf], [np.nan], [], [0.0, 0.0]):
        array = np.array(values, dtype=np.float32)
        packed = json.loads(json.dumps(packable(array)))
        assert_seen(unpacked(packed), np.where(np.isfinite(array), array, np.nan))
