"""Suffixes that say what a file is: photographs as import takes them, and pictures as other programs make them of them."""

LINEAR_SUFFIXES = frozenset({".exr", ".hdr"})
RAW_SUFFIXES = frozenset(
    f".{suffix}"
    for line in (
        "3fr ari arw bay cap cr2 cr3 crw dcr dcs dng drf eip erf fff gpr iiq k25 kdc mdc mef mos",
        "mrw nef nrw orf pef ptx pxn r3d raf raw rw2 rwl rwz sr2 srf srw x3f",
    )
    for suffix in line.split()
)
PICTURE_SUFFIXES = (
    LINEAR_SUFFIXES
    | RAW_SUFFIXES
    | {
        ".jpg",
        ".jpeg",
        ".jpe",
        ".jxl",
        ".jp2",
        ".png",
        ".tif",
        ".tiff",
        ".bmp",
        ".webp",
        ".heic",
        ".heif",
        ".avif",
    }
    | {".ppm", ".pgm", ".pnm", ".pfm", ".pic", ".tga", ".gif", ".psd", ".dpx"}
)
