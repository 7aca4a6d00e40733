"""SUPER-MAN: MOCA-MAN and Kairos-MAN (Giammarino et al., 2022)."""
