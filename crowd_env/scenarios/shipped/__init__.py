"""The scenarios with code of their own."""
