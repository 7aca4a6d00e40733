"""A stream of the Lab Streaming Layer in the simulated world, and an outlet that sends it."""
