"""Laws whose outputs the wearer feels."""
