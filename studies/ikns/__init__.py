"""Studies of the intrinsic kinematic null space (Lisini Baldi et al., 2023)."""
