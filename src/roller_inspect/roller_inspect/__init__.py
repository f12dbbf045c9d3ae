"""From events and poses to a surface, its text and their files."""
