"""What a message must be: one or a few sentences that are read, nothing said twice."""

import re

LONGEST = 600  # characters
REPEATED = 5  # words in a row that may not come again


def faults(text: str) -> list[str]:
    """What is wrong with a message; empty where nothing is."""
    found = []
    if "\n" in text:
        found.append("more than one line")
    if len(text) > LONGEST:
        found.append(f"{len(text)} characters")
    if not text.rstrip().endswith((".", "?", ")", "!")):
        found.append("no end")
    if re.search(r"Traceback|<class |<function |Array\(|array\(|dtype=|object at 0x", text):
        found.append("Python's own words")
    words = [word for word in re.findall(r"[\w.\[\]'-]+", text.lower()) if not re.fullmatch(r"[\d.e'-]+", word)]
    runs = [tuple(words[at : at + REPEATED]) for at in range(len(words) - REPEATED + 1)]
    twice = {" ".join(run) for run in runs if runs.count(run) > 1 and len(set(run)) > 2}
    if twice:
        found.append(f"said twice: {sorted(twice)[0]}")
    return found
