"""The controllers: what the window does, one part for each role; none of them knows a widget."""
