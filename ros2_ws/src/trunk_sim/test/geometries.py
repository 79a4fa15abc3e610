"""Two plants as they are drawn: the trunk on a path, and a pole on a cart, which its command pushes."""

from trunk_msgs_util.picture.frames import Frame, resolved
from trunk_msgs_util.picture.shapes import Geometry
from trunk_sim.plants.cart_pole import PICTURE as CART_POLE

TRUNK = {
    "plant.length": 1.3,
    "path.amplitude": 0.7,
    "path.wavenumber": 2.0,
    "path.cosines": [],
    "path.sines": [],
    "joints": ["hip", "trunk"],
}
ARMS = CART_POLE._replace(  # on a pivot
    frames=(Frame("arm", at=(0.2, 0.1), turns=0), Frame("pole", "arm", (0.3, 0.0), turns=1)),
    visuals=(CART_POLE.visuals[0]._replace(frame="arm"), *CART_POLE.visuals[1:]),
    track=None,
)


def trunk(**parameters):
    """Return the trunk with other parameters: `_` in place of a name's dot."""
    return Geometry.from_parameters(
        {**TRUNK, **{name.replace("_", "."): value for name, value in parameters.items()}}
    )


def cart_pole(picture=CART_POLE, length=0.5):
    return Geometry(resolved(picture, {"plant.length": length}), ("cart", "pole"), 0)
