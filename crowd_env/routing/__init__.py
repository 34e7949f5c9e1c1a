"""The route of each pedestrian over time: strategies, control rules, doors, replanning."""
