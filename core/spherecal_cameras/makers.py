"""Makers of cameras, the package that has each one's driver, and where its .cti files are once it is installed.

Installers also name these folders in GENICAM_GENTL64_PATH. `source` says where a row was read (2026-11): a maker's own
page, a thread, or a public program. "text" means public programs that name the exact path, found by a search over
public source text that does not name their repositories. Nothing here was tried with a real installation.
"""

import os
from collections.abc import Iterator, Mapping
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
    source: str = ""
    variables: tuple[str, ...] = ()  # folders or files below a variable that its installer sets: `{VARIABLE}/cti`
    aliases: tuple[str, ...] = ()  # other words by which its cameras name their maker, in small letters

    def folders(self, system: str) -> tuple[str, ...]:
        """The folders on a system, by Python's name of it (`linux`, `win32`, `darwin`)."""
        return {"linux": self.linux, "win32": self.windows, "darwin": self.macos}.get(system, ())


_HARVESTERS = "github.com/genicam/harvesters/issues"

MAKERS = (
    Maker(
        "Basler",
        "pylon",
        ("ProducerGEV.cti", "ProducerU3V.cti"),
        ("/opt/pylon/lib/gentlproducer/gtl", "/opt/pylon*/lib*/gentlproducer/gtl"),
        (r"C:\Program Files\Basler\pylon*\Runtime\x64",),
        ("/Library/Frameworks/pylon.framework/Libraries/gentlproducer/gtl",),
        "Windows: IvoVellekoop/openwfs, openwfs/devices/camera.py (pylon 7). Linux: text, 1 program. macOS: no source",
    ),
    Maker(
        "Allied Vision",
        "Vimba X",
        ("VimbaGigETL.cti", "VimbaUSBTL.cti"),
        ("/opt/VimbaX*/cti", "/opt/VimbaGigETL/CTI/x86_64bit", "/opt/Vimba_*/Vimba*TL/CTI/x86_64bit"),
        (r"C:\Program Files\Allied Vision\Vimba X\cti", r"C:\Program Files\Allied Vision\Vimba_*\Vimba*TL\Bin\Win64"),
        source="Linux: docs.alliedvision.com/installation.html ([InstallDir]/cti); titusjan/peprc, vimbax.sh (/opt). "
        "Windows: text, 1 program for Vimba X, 3 for Vimba 3.1 and 4.0",
        aliases=("alliedvision", "avt", "prosilica"),
    ),
    Maker(
        "Balluff, MATRIX VISION",
        "Impact Acquire",
        ("mvGenTLProducer.cti",),
        (
            "/opt/ImpactAcquire/lib/x86_64",
            "/opt/ImpactAcquire/lib/arm64",
            "/opt/mvIMPACT_Acquire/lib/x86_64",
            "/opt/mvIMPACT_Acquire/lib/arm64",
        ),
        (
            r"C:\Program Files\Balluff\ImpactAcquire\bin\x64",
            r"C:\Program Files\Balluff\Impact Acquire\bin\x64",
            r"C:\Program Files\MATRIX VISION\mvIMPACT Acquire\bin\x64",
        ),
        source=f"mvIMPACT: {_HARVESTERS}/216 (Windows), /200 (Linux). Impact Acquire: text, more than 10 programs each",
        aliases=("balluff", "matrixvision"),
    ),
    Maker(
        "Teledyne FLIR",
        "Spinnaker SDK",
        ("Spinnaker_GenTL*.cti",),
        ("/opt/spinnaker/lib/spinnaker-gentl", "/opt/spinnaker/lib/flir-gentl"),
        (r"C:\Program Files\Teledyne\Spinnaker\cti64\*", r"C:\Program Files\FLIR Systems\Spinnaker\cti64\*"),
        ("/Applications/Spinnaker/lib/spinnaker-gentl",),
        "Windows: softwareservices.flir.com/Spinnaker/latest/guides/producers.html, also the variables. Linux: "
        "Sir-Photch/PKGBUILDS, spinnaker-sdk/spinnaker-gentl-64.sh; flir-gentl and macOS: text, 1 program each. "
        "FLIR Systems: no source",
        ("{SPINNAKER_GENTL64_CTI}", "{SPINNAKER_GENTL64CTI_VS140}"),
        ("flir", "pointgrey"),
    ),
    Maker(
        "IDS",
        "IDS peak",
        ("ids_gevgentlk.cti", "ids_u3vgentlk.cti"),
        ("/usr/lib/ids/cti", "/opt/ids-peak*/lib/*/ids-peak/cti", "/opt/ids-peak*/lib/ids/cti"),
        (r"C:\Program Files\IDS\ids_peak\ids_*gentl\64",),
        source="Text: 1 program for both systems, 1 that names an installed 26.06 (Windows), 3 for /opt/ids-peak on "
        "arm64; lib/ids/cti: no source",
        aliases=("idsimaging",),
    ),
    Maker(
        "Baumer",
        "Baumer GAPI SDK",
        ("bgapi2_gige.cti", "bgapi2_usb.cti"),
        ("/opt/baumer-gapi-sdk-*/lib",),
        (r"C:\Program Files\Baumer\Baumer GAPI SDK\bin", r"C:\Program Files\Baumer Camera Explorer"),
        source="Text: 1 program that names an installed 2.16.1 (Linux), 2 and 1 for Windows",
    ),
    Maker(
        "HIKROBOT",
        "MVS",
        ("MvProducerGEV.cti", "MvProducerU3V.cti"),
        ("/opt/MVS/lib/64", "/opt/MVS/lib/aarch64"),
        (
            r"C:\Program Files (x86)\Common Files\MVS\Runtime\Win64_x64",
            r"C:\Program Files\Common Files\MVS\Runtime\Win64_x64",
        ),
        source=f"{_HARVESTERS}/442 (both systems), blog.csdn.net/hawkzhang3k/article/details/132852804 (the variable "
        "on Windows). Text: more than 10 programs; 3 of them also name Program Files without (x86). aarch64: no source",
        variables=("{MVCAM_COMMON_RUNENV}/64",),
        aliases=("hikvision", "hik"),
    ),
    Maker(
        "Daheng Imaging",
        "Galaxy SDK",
        ("GxGVTL.cti", "GxU3VTL.cti"),
        ("/usr/lib",),
        (r"C:\Program Files\Daheng Imaging\GalaxySDK\GenTL\Win64",),
        source="Text: 4 programs (Windows), 4 (Linux)",
        aliases=("daheng",),
    ),
    Maker(
        "LUCID Vision Labs",
        "Arena SDK",
        ("GenTL_LUCID*.cti",),
        ("/opt/ArenaSDK_Linux*/lib64",),
        (r"C:\Program Files\Lucid Vision Labs\Arena SDK\x64Release",),
        source="Text: 3 programs (Windows), 2 that name GenTL_LUCID.cti in lib64, 1 with ArenaSDK_Linux_x64 in /opt; "
        "on Linux it may be unpacked anywhere",
        aliases=("lucid",),
    ),
    Maker(
        "JAI",
        "JAI SDK",
        ("JaiGevTL.cti", "JaiUSB3vTL.cti"),
        (),
        (r"C:\Program Files\JAI\SDK\bin", r"C:\Program Files\JAI\SDK\bin\win64_x64"),
        source=f"{_HARVESTERS}/216. Text: 4 programs. Linux: eBUS SDK instead, "
        "mathworks.com/matlabcentral/answers/2089171",
    ),
    Maker(
        "SVS-Vistek",
        "SVCam Kit",
        ("sv_gev_tl_x64.cti", "sv_u3v_tl_x64.cti"),
        ("/opt/SVS/SVCamKit/SDK/Linux64_x64/cti",),
        (r"C:\Program Files\SVS-VISTEK GmbH\SVCam Kit\TL*\bin",),
        source="Text: 3 programs (Windows), 2 copies of its install script (Linux, also the variable)",
        variables=("{SVS_SDK_BIN_64}/cti",),
        aliases=("svsvistek",),
    ),
    Maker(
        "XIMEA",
        "XIMEA Software Package",
        ("ximea.gentl*.cti",),
        ("/opt/XIMEA/lib",),
        (r"C:\XIMEA\GenTL Producer\x64",),
        source="mathworks.com/help/imaq/genicam-gentl-hardware.html (Windows, x86); itom-project/plugins, "
        "GenICam/genicam.cpp (x64). Text: 5 programs and an installer's script (Linux)",
    ),
    Maker(
        "Teledyne DALSA",
        "Sapera LT, GigE-V Framework",
        ("*.cti",),
        (),
        (r"C:\Program Files\Teledyne DALSA\*\GenTL\cti\x64",),
        source="softwareservices.flir.com/Spinnaker/latest/guides/producers.html, for its Xtium2 boards only. Of a "
        "producer for its GigE cameras nothing public was found, on either system",
        aliases=("dalsa",),
    ),
    Maker(
        "The Imaging Source",
        "IC4 GenTL drivers",
        ("ic4-gentl-gev_x64.cti", "ic4-gentl-u3v_x64.cti"),
        (),
        (r"C:\Program Files\The Imaging Source Europe GmbH\IC4 GenTL Driver for *\bin",),
        source="Text: 4 programs, one of them with the versions of an installed 1.6. Linux: packages exist "
        "(dl-gui.theimagingsource.com); of their folder nothing public was found",
        aliases=("imagingsource",),
    ),
    Maker(
        "iRayple, Huaray",
        "iCentral, MV Viewer",
        ("MVProducerGEV.cti", "MVProducerU3V.cti"),
        (),
        (
            r"C:\Program Files\iCentral\iCentral\Runtime\x64",
            r"C:\Program Files\HuarayTech\MV Viewer\Runtime\x64",
            r"C:\Program Files\IRayple\MVP\Application\win64\CameraProcol\Cti",
        ),
        source="Text: 5 programs (iCentral), 1 each for the others. Linux: installs to /opt/HuarayTech/MVviewer; that "
        "a producer is there was not found",
        aliases=("irayple", "huaray", "dahua"),
    ),
    Maker(
        "Omron Sentech",
        "SentechSDK",
        ("libstgentl.cti",),
        ("/opt/sentech/lib",),
        source="Text: 7 programs (Linux), one with what an installed one says of itself. Windows: not found",
        aliases=("sentech", "omron"),
    ),
    Maker(
        "STEMMER IMAGING",
        "Common Vision Blox",
        ("*GevTL.cti", "*.cti"),
        ("/opt/cvb*/drivers/genicam",),
        (r"C:\Program Files\STEMMER IMAGING\*\Drivers\GenICam",),
        source="Text: 5 programs (Linux). Windows: no source",
    ),
    Maker(
        "Euresys",
        "eGrabber",
        ("coaxlink.cti", "gigelink.cti", "grablink.cti"),
        ("/opt/euresys/*/lib/x86_64",),
        (r"C:\Program Files\Euresys\*\cti\x86_64",),
        source="Text: 3 programs (Linux; one tried it with a camera), 1 (Windows, coaxlink.cti)",
    ),
)
# Any maker's GigE Vision and USB3 Vision cameras, on Linux: our own, after the makers' own.
ANY_MAKER = Maker("", "Aravis", ("spherecal_aravis.cti",), ("/opt/spherecal/cti",), source="our own")
_FIRST = {"linux": ("/opt/*/lib/x86_64",)}
_LAST = {"darwin": ("/Library/Application Support/*/cti",)}
# Folders that also hold whatever other programs put there: only a maker's own files are taken from them.
_SHARED = ("/usr/lib",)


def own_folder() -> Path:
    """Where the built-in driver is put for this user (`builtin_driver.prepare`); it may not exist."""
    from platformdirs import user_data_path

    return user_data_path("spherecal", appauthor=False) / "cti"


def driver_folders(system: str) -> tuple[str, ...]:
    """The folders of drivers on a system, with `*`, in the order in which they are tried."""
    own = [folder for maker in (*MAKERS, ANY_MAKER) for folder in maker.folders(system)]
    return (*_FIRST.get(system, ()), *own, *_LAST.get(system, ()))


def driver_patterns(system: str, environment: Mapping[str, str] = os.environ) -> Iterator[str]:
    """Patterns of driver files on a system, in the order in which they are tried: of folders, then of variables."""
    separator = "\\" if system == "win32" else "/"
    files = {folder: maker.files for maker in MAKERS for folder in maker.folders(system) if folder in _SHARED}
    for folder in driver_folders(system):
        yield from (f"{folder}{separator}{file}" for file in files.get(folder, ("*.cti",)))
    for maker in MAKERS:
        for place in maker.variables:
            name = place[1 : place.index("}")]
            if known := environment.get(name, ""):
                named = place.replace(f"{{{name}}}", known.rstrip("/\\"))
                yield named if named.endswith(".cti") else f"{named}{separator}*.cti"


def maker_of(vendor: str) -> Maker | None:
    """The maker that a camera names, whatever it adds (`Basler AG`, `AVT`); None where it is none of these."""
    said = "".join(filter(str.isalnum, vendor)).lower()
    for maker in MAKERS:
        own = "".join(filter(str.isalnum, maker.name)).lower()
        if said and any(said.startswith(word) or word in said for word in (own, *maker.aliases) if len(word) > 3):
            return maker
        if any(said == word for word in (own, *maker.aliases)) or vendor.split()[:1] == [maker.name]:
            return maker
    return None
