"""Experiments with known truth: what the sensor's pipelines get right, in numbers."""
