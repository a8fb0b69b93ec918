"""Photographs: reading and writing pictures, a virtual polariser, captures through a real one."""
