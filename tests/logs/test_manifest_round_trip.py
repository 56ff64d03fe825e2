"""Whatever a manifest may say is read back as it was written."""

from pathlib import PurePath

from hypothesis import given, settings
from hypothesis import strategies as st

from butterfly.logs.health import DEFAULT_REPAIRS, Repair
from butterfly.logs.log import InputKind, Intersample
from butterfly.logs.manifest import (
    LogEntry,
    Manifest,
    Recordings,
    manifest_text,
    read_manifest,
    write_manifest,
)

TEXTS = st.text(st.characters(codec="utf-8"), max_size=12)
PLAIN = TEXTS.filter(lambda text: not PurePath(text).is_absolute() and ".." not in text)
SIZES = st.floats(0, 1e3)
TOLD = st.floats(-1e3, 1e3) | st.fixed_dictionaries(
    {"value": st.floats(-1e3, 1e3), "uncertainty": st.floats(1e-9, 10)}
)
ENTRIES = st.builds(
    LogEntry,
    file=PLAIN,
    added_mass=SIZES,
    arm=st.none() | SIZES,
    zero=st.none() | TOLD,
    begin=st.none() | st.floats(0, 5),
    end=st.none() | st.floats(6, 9),
    part=st.none() | st.integers(1, 9),
)
MANIFESTS = st.builds(
    Manifest,
    name=TEXTS,
    description=TEXTS,
    root=PLAIN.filter(lambda text: "$" not in text),
    input=st.sampled_from(InputKind),
    intersample=st.sampled_from(Intersample),
    sign=st.sampled_from([1, -1]),
    arm=SIZES,
    known=st.dictionaries(st.sampled_from(["p1", "p4", "resistance"]), st.floats(0.1, 1e3)),
    zero=st.none() | TOLD,
    units=st.fixed_dictionaries({}, optional={"time": st.just("ms"), "angle": st.floats(0.1, 9)}),
    columns=st.none()
    | st.fixed_dictionaries({"time": TEXTS, "input": st.integers(0, 9), "angle": TEXTS}),
    repair=st.sets(st.sampled_from(Repair)).map(DEFAULT_REPAIRS.union),
    split=st.none() | st.sampled_from(Recordings),
    holdout=st.lists(TEXTS, max_size=2),
    logs=st.lists(ENTRIES, min_size=1, max_size=3),
)


@settings(max_examples=100, deadline=None)
@given(manifest=MANIFESTS)
def test_any_manifest_is_read_back_as_it_was(tmp_path_factory, manifest):
    path = tmp_path_factory.getbasetemp() / "manifest.yaml"
    write_manifest(manifest, path)
    read = read_manifest(path, path.parent).model_copy(update={"root": manifest.root})
    assert read == manifest
    assert manifest_text(read) == manifest_text(manifest)
