"""Stage 3: the torn body: interfaces, supports and the contact boundary of all subdomains, and the
rows between them.
"""

import numpy as np

from ..feti.numbering import fixed_dofs, number
from ..feti.skeleton import Skeleton
from ..feti.structure import Substructure
from ..scene.loader import Subdomain
from ..scene.manifest import Manifest
from .boundary import contact_boundary


def build(manifest: Manifest, subdomains: list[Subdomain], first: int, comm,
          moved: list | None = None) -> Substructure:
    """Derive corners, rows and numbering; collective over `comm`.

    `moved`: displacements (dofs,) of the subdomains about which contact between bodies is
    linearized, if not about none. Raises InputError for interfaces that do not conform and for
    contact labels without nodes.
    """
    skeleton = Skeleton(manifest, subdomains, comm)
    skeleton.check_conformity(comm)
    skeleton.check_overlap(np.unique(manifest.contact_pairs))
    fixed = fixed_dofs(manifest, subdomains, comm)
    contact = contact_boundary(manifest, subdomains, skeleton, fixed, comm, moved)
    return number(manifest, subdomains, first, skeleton, fixed, contact, comm)
