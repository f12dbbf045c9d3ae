"""Height maps and findings in files that other software reads."""
