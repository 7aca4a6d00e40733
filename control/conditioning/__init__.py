"""General laws for signals of any device or law: scaled, filtered, chosen."""
