"""Golden outputs: what every verb gives on examples and simulated runs, compared with what is stored.

`pytest tests/golden` runs the chapters that take seconds, `make trials` those that take minutes as well. By hand:

    python -m tests.golden                       # all that take seconds
    python -m tests.golden panels roof           # two chapters
    python -m tests.golden --long                # all
    python -m tests.golden --prose predictions   # sentences too, which are not compared otherwise
    python -m tests.golden --write panels        # store what is found

Compared are exit codes, the JSON on standard output, the set of files written, and the numbers in JSON, JSONL, CSV,
TOML, FITS, NumPy and HDF5 files. The screen of a result has to begin with a sentence, and shows no rounding as 1e-16. A
number may move by 1e-9 of itself or of the standard error that is stated next to it; pictures, shifts and named faults
by more, since another processor rounds otherwise (`_ROUNDED` in harness.py). Not compared are tables and sentences for
people, pictures and pages (only that they are there), times, versions, paths and hashes.

What chapters of minutes give is stored compressed. After an intended change run without `--write`, read what differs,
then run with it, and say in the commit message which numbers changed and why. A verb or option that gets another name
is changed in `cases.py` only.
"""
