"""Independent operation: a supernumerary arm repeats the path of a hand, by itself (docs/independent-operation.md)."""
