"""What tests of profiles, drivers, laws and parts need; `srl.testing` is its public face. It imports nothing."""
