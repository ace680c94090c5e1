"""The pages, one file each; each is built when it is first entered."""
