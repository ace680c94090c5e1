"""The other methods: a plane board and a bar waved through the volume."""
