"""Certified tubes along a path: those that travel with the package, for any bicycle, and which of them holds where."""

from cfjax.tubes.certificate import chain_document, write_chain
from cfjax.tubes.certified import CertifiedTube
from cfjax.tubes.follow import Following, Link, Stretch, follow
from cfjax.tubes.store import library, library_files, read_tube
from cfjax.tubes.vehicles import for_vehicle, scaled


__all__ = [
    "CertifiedTube",
    "Following",
    "Link",
    "Stretch",
    "chain_document",
    "follow",
    "for_vehicle",
    "library",
    "library_files",
    "read_tube",
    "scaled",
    "write_chain",
]
