"""Offenders against a rule of the house that are still allowed. A number may only go down."""

DEBTS = {
    "modules in cycles": 32,
    "classes that know their children": 0,
    "packages with code in their __init__": 0,
    "functions above 60 lines": 10,
    "functions with more than 8 parameters": 12,
    "lines of Python in the wheel": 48_000,
    "classes of weight filters": 11,
    "types of memory": 8,
    "modules on the walk of spread": 10,
    "modules on the walk of a sample": 8,
    "first lines that are no noun phrase": 710,
    "arguments with a shape and no unit": 380,
    "functions that raise and do not say so": 12,
}


def within(name: str, offenders: list[str], count: int | None = None) -> None:
    """Refuse more offenders than are allowed, and show them.

    Args:
        name: Key of `DEBTS`.
        offenders: Their places.
        count: How many there are where `offenders` are groups.
    """
    found = len(offenders) if count is None else count
    shown = "\n".join(offenders)
    assert found <= DEBTS[name], f"{found} {name}, {DEBTS[name]} allowed:\n{shown}"
