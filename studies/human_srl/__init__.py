"""Experiments with a person's and an extra limb's common skeleton."""
