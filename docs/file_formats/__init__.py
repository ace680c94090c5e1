"""What every file of SphereCal holds, as JSON Schemas: docs/schemas and the tables of docs/formats.md are made of it."""  # noqa: E501

from file_formats.other import FORMATS as _OTHER
from file_formats.results import FORMATS as _RESULTS
from file_formats.sessions import FORMATS as _SESSIONS
from file_formats.settings import FORMATS as _SETTINGS
from file_formats.vocabulary import Format as _Format
from spherecal.files.codec import Format

FORMATS: tuple[_Format | Format, ...] = (*_SESSIONS, *_RESULTS, *_SETTINGS, *_OTHER)
