"""The experiments of [Tao21], repeated on simulated rigs: trials, an executor for them, and their pages."""

from spherecal_study.kept_pages import KeptPage, pages

__all__ = ["KeptPage", "pages"]
