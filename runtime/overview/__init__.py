"""What `srl check --all` says of a profile."""
