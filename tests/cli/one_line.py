"""How a command says that its input is bad, and that it is done."""


def done(result):
    """What was printed, and nothing beside it."""
    code, out, err = result
    assert (code, err) == (0, "")
    return out


def assert_one_line_error(result, *parts):
    code, _, err = result
    assert code == 2
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert "Traceback" not in err
    for part in parts:
        assert str(part) in err
