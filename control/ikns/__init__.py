"""Control from the redundancy of the wearer's own arm (Lisini Baldi et al. 2023): docs/ikns.md, docs/arm-angles.md."""
