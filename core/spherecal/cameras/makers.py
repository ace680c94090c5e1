"""Makers of cameras, the package that has each one's driver, and where its .cti files are once it is installed.

Installers also name these folders in GENICAM_GENTL64_PATH. Where a maker's file name is not known for certain, it is
`*.cti`.
"""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Maker:
    """A maker, its driver's package, file names and folders (with `*` for versions) on Linux, Windows and macOS."""

    name: str
    driver: str
    files: tuple[str, ...]
    linux: tuple[str, ...] = ()
    windows: tuple[str, ...] = ()
    macos: tuple[str, ...] = ()

    def folders(self, system: str) -> tuple[str, ...]:
        """The folders on a system, by Python's name of it (`linux`, `win32`, `darwin`)."""
        return {"linux": self.linux, "win32": self.windows, "darwin": self.macos}.get(system, ())


MAKERS = (
    Maker(
        "Basler",
        "pylon",
        ("ProducerGEV.cti", "ProducerU3V.cti"),
        ("/opt/pylon/lib/gentlproducer/gtl", "/opt/pylon*/lib*/gentlproducer/gtl"),
        (r"C:\Program Files\Basler\pylon*\Runtime\x64",),
        ("/Library/Frameworks/pylon.framework/Libraries/gentlproducer/gtl",),
    ),
    Maker(
        "Allied Vision",
        "Vimba X",
        ("VimbaGigETL.cti", "VimbaUSBTL.cti"),
        ("/opt/VimbaX*/cti", "/opt/Vimba_*/Vimba*TL/CTI/x86_64bit"),
        (r"C:\Program Files\Allied Vision\Vimba*\*", r"C:\Program Files\Allied Vision\Vimba*\*\Bin\Win64"),
    ),
    Maker(
        "Balluff, MATRIX VISION",
        "Impact Acquire",
        ("mvGenTLProducer.cti",),
        ("/opt/ImpactAcquire/lib/x86_64", "/opt/mvIMPACT_Acquire/lib/x86_64"),
        (r"C:\Program Files\Balluff\*\bin\x64", r"C:\Program Files\MATRIX VISION\mvIMPACT Acquire\bin\x64"),
    ),
    Maker(
        "Teledyne FLIR",
        "Spinnaker SDK",
        ("Spinnaker_GenTL*.cti",),
        ("/opt/spinnaker/lib/*",),
        (r"C:\Program Files\Teledyne\Spinnaker\cti64\*", r"C:\Program Files\FLIR Systems\Spinnaker\cti64\*"),
    ),
    Maker(
        "IDS",
        "IDS peak",
        ("ids_gevgentl.cti", "ids_u3vgentl.cti"),
        ("/opt/ids-peak*/lib/ids/cti", "/usr/lib/ids/cti"),
        (r"C:\Program Files\IDS\ids_peak\*\bin", r"C:\Program Files\IDS\ids_peak\*\64"),
    ),
    Maker(
        "Baumer",
        "Baumer GAPI SDK",
        ("bgapi2_gige.cti", "bgapi2_usb.cti"),
        ("/opt/baumer-gapi-sdk-*/lib",),
        (r"C:\Program Files\Baumer\Baumer GAPI SDK\bin",),
    ),
    Maker(
        "HIKROBOT",
        "MVS",
        ("MvProducerGEV.cti", "MvProducerU3V.cti"),
        ("/opt/MVS/lib/64",),
        (r"C:\Program Files\Common Files\MVS\Runtime\Win64_x64",),
    ),
    Maker(
        "JAI",
        "JAI SDK",
        ("JaiGevTL.cti", "JaiUSB3vTL.cti"),
        (),
        (r"C:\Program Files\JAI\*\bin",),
    ),
    Maker("The Imaging Source", "IC Imaging Control, GenTL", ("*.cti",), ("/opt/TIS/*/lib",)),
    Maker("Omron Sentech", "SentechSDK", ("*.cti",), ("/opt/sentech/lib",)),
    Maker(
        "STEMMER IMAGING",
        "Common Vision Blox",
        ("*.cti",),
        ("/opt/cvb*/drivers/genicam",),
        (r"C:\Program Files\STEMMER IMAGING\*\Drivers\GenICam",),
    ),
    Maker(
        "Euresys",
        "eGrabber",
        ("*.cti",),
        ("/opt/euresys/*/lib/x86_64",),
        (r"C:\Program Files\Euresys\*\cti\x86_64",),
    ),
)
# Any maker's GigE Vision and USB3 Vision cameras, on Linux: our own, after the makers' own.
ANY_MAKER = Maker("", "Aravis", ("spherecal_aravis.cti",), ("/opt/spherecal/cti",))
_FIRST = {"linux": ("/opt/*/lib/x86_64",)}
_LAST = {"darwin": ("/Library/Application Support/*/cti",)}


def own_folder() -> Path:
    """Where the built-in driver is put for this user (`builtin_driver.prepare`); it may not exist."""
    from platformdirs import user_data_path

    return user_data_path("spherecal", appauthor=False) / "cti"


def driver_folders(system: str) -> tuple[str, ...]:
    """The folders of drivers on a system, with `*`, in the order in which they are tried."""
    own = [folder for maker in (*MAKERS, ANY_MAKER) for folder in maker.folders(system)]
    return (*_FIRST.get(system, ()), *own, *_LAST.get(system, ()))
