"""What `srl show` says of a profile."""
