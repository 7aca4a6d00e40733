"""A simulated program that sends numbers by UDP."""
