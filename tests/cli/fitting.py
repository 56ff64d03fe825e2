"""Whether what a command prints fits 80 columns."""


def assert_tables_fit(out):
    """Each line of a table fits, whatever the sentences around it."""
    lines = out.splitlines()
    tables = [line for line in lines if line.startswith("  ")]
    assert tables
    assert [line for line in tables if len(line) > 80] == []
    assert not any(line.endswith(" ") for line in lines)
