"""The papers' experiments, on simulated devices or on hardware, and what evaluates them."""
