"""Measuring tools on a height map: each gives a value with its uncertainty and unit."""
