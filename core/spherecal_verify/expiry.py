"""Whether a bar's certificate holds on a day."""

import datetime

from spherecal.base.messages.values import Phrase
from spherecal.data.session import Certificate

# A shop needs a few weeks to send a bar away and have it back.
_SOON_DAYS = 30


def expiry(certificate: Certificate | None, today: datetime.date) -> tuple[str, Phrase] | None:
    """`expired`, `expires-soon`, `not-yet` or `no-certificate` with its words; None where nothing is to be said."""
    if certificate is None:
        return "no-certificate", Phrase("has-no-certificate")
    if certificate.date is not None and certificate.date > today:
        return "not-yet", Phrase("certificate-from", {"date": str(certificate.date)})
    until = certificate.valid_until
    if until is None:
        return None
    values = {"number": certificate.number, "date": str(until)}
    if until < today:
        return "expired", Phrase("certificate-until", values)
    if (until - today).days <= _SOON_DAYS:
        return "expires-soon", Phrase("certificate-still-until", values)
    return None
