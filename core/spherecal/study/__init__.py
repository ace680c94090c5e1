"""The experiments of [Tao21], repeated on simulated rigs: trials, an executor for them, and their pages."""
