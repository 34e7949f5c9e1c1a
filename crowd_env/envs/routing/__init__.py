"""``crowd_env/routing-v0``: one controller that sends people to exits."""
