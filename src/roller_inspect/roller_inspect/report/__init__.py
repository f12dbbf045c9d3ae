"""The report of an inspection: `inspection.json`, and `inspection.html` for who signs it."""
