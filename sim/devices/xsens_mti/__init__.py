"""An Xsens MTi: its fake and its twin."""
