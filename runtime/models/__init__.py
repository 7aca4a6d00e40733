"""What `models:` of a profile describes: robots, a hand, a body, worn arms, motion trees."""
