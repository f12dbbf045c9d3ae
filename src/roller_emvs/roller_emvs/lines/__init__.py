"""Lines through the events of features: exact places and heights, with their uncertainty."""
