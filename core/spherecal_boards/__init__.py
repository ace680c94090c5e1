"""Settings and stages of the method with a ball; the other methods: a plane board, a bar waved through the volume."""
