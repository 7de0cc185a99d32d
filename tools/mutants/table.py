"""The table of what the trials found."""

from results import EQUIVALENT, KILLED, SURVIVED

BEGIN, END = "<!-- written by make mutants -->", "<!-- end -->"


def lines(mutants, results):
    """Give the table by area, what survived, and why the equivalent ones are, as Markdown."""
    counts = {}
    for mutant in mutants:
        counts.setdefault(mutant.area, []).append(results.of(mutant))
    counts["all"] = [found for area in counts.values() for found in area]
    table = [
        "| | mutations | killed | equivalent | survived | not tried |",
        "|---|---|---|---|---|---|",
    ]
    for area, found in counts.items():
        of = [found.count(what) for what in (KILLED, EQUIVALENT, SURVIVED)]
        cells = [area, len(found), *of, len(found) - sum(of)]
        table.append("| " + " | ".join(str(cell) for cell in cells) + " |")
    survived = [
        f"- `{mutant.name}` in `{mutant.file}`"
        for mutant in mutants
        if results.of(mutant) == SURVIVED
    ]
    reasons = [
        f"- `{mutant.name}`: {mutant.equivalent.strip()}" for mutant in mutants if mutant.equivalent
    ]
    if survived:
        table += ["", "Survived:", "", *survived]
    if reasons:
        table += ["", "No test can tell these from the original:", "", *reasons]
    return table


def write_section(page, text):
    """Put `text` between the two marks of `page`."""
    before, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    page.write_text("\n".join([before + BEGIN, "", *text, "", END + after]), encoding="utf-8")
