"""``crowd_env/Routing-v0``: one controller that sends people to exits."""
