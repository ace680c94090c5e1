"""Documents of a rig: report, exports and imports, the scene in space, printed sheets, support bundle."""
