"""Scenarios in TOML and JSON files."""
