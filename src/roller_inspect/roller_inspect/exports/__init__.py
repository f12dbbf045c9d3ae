"""Height maps and findings in files that other software reads."""

#: What is written where it is asked for, by the ending of its name.
EXPORTS = ("x3p", "sdf", "pdf")
