"""The experiments of [Tao21], repeated on simulated rigs: trials, an executor for them, and their pages."""

from spherecal_study.studies import KeptPage, pages

__all__ = ["KeptPage", "pages"]
