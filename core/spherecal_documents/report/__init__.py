"""The report of a result folder: a PDF to read, print and keep, and its pictures."""
