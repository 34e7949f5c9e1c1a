"""Who takes which route, and when: strategies, control rules, doors, replanning."""
