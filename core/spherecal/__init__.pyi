# What a type checker sees of the package.
from spherecal_app.api import *  # noqa: F403

__version__: str
__all__: list[str]
