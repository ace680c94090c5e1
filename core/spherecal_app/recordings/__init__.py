"""A session from folders of images, videos and tables as people have them."""
