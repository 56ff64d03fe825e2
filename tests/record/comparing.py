"""Two records beside each other."""

import math

BY_PARAMETER = {"value", "lower", "upper", "left_out", "rival"}
SMALL = 1e-6  # of the largest number of a quantity; below it, differences count relative to that
PER_CENT = {"fit", "held_out"}


def compare(old, new, relative, *, words=False):
    """Return lines that say what differs, and whether that is too much."""
    lines, counts = [], {"identical": 0, "within": 0, "beyond": 0}
    largest = 0.0
    for name in sorted({*old, *new}):
        if name not in old or name not in new:
            lines.append(f"{name}: missing in the {'old' if name not in old else 'new'} record")
            counts["beyond"] += 1
            continue
        shown, texts = numbers_apart(old[name], new[name]), texts_apart(old[name], new[name])
        apart = max((each[0] for each in shown.values()), default=0.0)
        largest = max(largest, apart)
        beyond = texts or apart > relative
        counts["beyond" if beyond else "within" if apart else "identical"] += 1
        if apart or texts:
            lines.append(f"{name}:")
        lines += [f"  {quantity}: {said}" for quantity, (_, said) in shown.items()]
        lines += [f"  {each}" for each in texts]
        if words and old[name]["words"] != new[name]["words"]:
            lines.append(f"{name}: other words")
            lines += [
                f"  - {each}" for each in old[name]["words"] if each not in new[name]["words"]
            ]
            lines += [
                f"  + {each}" for each in new[name]["words"] if each not in old[name]["words"]
            ]
    lines.append(
        f"{sum(counts.values())} cases: {counts['identical']} to the last digit, "
        f"{counts['within']} within {relative:g}, {counts['beyond']} beyond it or otherwise; "
        f"largest difference {largest:.3g}"
    )
    return lines, counts["beyond"] > 0


def numbers_apart(old, new):
    """Return the largest relative difference of each quantity that differs, and where it is."""
    found = {}
    for quantity in sorted({*old["numbers"], *new["numbers"]}):
        a, b = (each["numbers"].get(quantity, {}) for each in (old, new))
        floor, rows = _floor(quantity, a), []
        for key in {**a, **b}:
            if key not in a or key not in b:
                rows.append((math.inf, f"{key} only in the {'new' if key in b else 'old'}"))
            elif a[key] != b[key]:
                error = _error(quantity, key, old["numbers"])
                rows.append(_apart(key, a[key], b[key], error, floor))
        if rows:
            found[quantity] = max(rows)
    return found


def _apart(key, a, b, error, floor):
    """Return the difference of a number, relative to its size and error, and what to say of it."""
    said = f"{key} {a} -> {b}"
    if not (_usual(a) and _usual(b)):
        return math.inf, said
    relative = abs(a - b) / max(abs(a), abs(b), error or floor)
    in_errors = f", {abs(a - b) / error:.2g} standard errors" if error else ""
    return relative, f"{relative:.3g} relative{in_errors} ({said})"


def _error(quantity, key, numbers):
    """Return the scale that errors give a number, half the interval where there is none, or 0."""
    errors, names = numbers.get("standard_error", {}), key.split()
    if quantity == "covariance":
        sizes = [errors.get(name) for name in names]
        return math.sqrt(math.prod(sizes)) if len(sizes) == 2 and all(map(_usual, sizes)) else 0.0
    if quantity not in BY_PARAMETER:
        return 0.0
    if _usual(errors.get(names[-1])):
        return errors[names[-1]]
    lower, upper = (numbers.get(limit, {}).get(names[-1]) for limit in ("lower", "upper"))
    return (upper - lower) / 2 if _usual(lower) and _usual(upper) else 0.0


def _floor(quantity, numbers):
    if quantity in PER_CENT:
        return 1.0
    sizes = [abs(each) for each in numbers.values() if _usual(each)]
    share = 1.0 if quantity == "prediction" else SMALL
    return share * max(sizes, default=0.0) or 1e-300


def _usual(number):
    return isinstance(number, float) and math.isfinite(number)


def texts_apart(old, new):
    """Return what else differs: verdict, findings, refusals."""
    a, b = old["texts"], new["texts"]
    return [
        f"{key}: {a.get(key)} -> {b.get(key)}"
        for key in sorted({*a, *b})
        if a.get(key) != b.get(key)
    ]
