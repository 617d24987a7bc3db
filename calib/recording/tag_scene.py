"""Tag scene: tag, reference and lens of a recording, and the tags and marks that pictures show."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..common.arrays import Array
from ..common.atomic import FilePath, atomic_write
from ..common.choices import DICTIONARY
from ..common.wording import listing
from ..errors import LogError, OptionError
from ..samples.lens import Lens
from .board import LEAST_CORNERS, CharucoPattern
from .lens import refuse_size
from .pictures import Picture, Shot, opencv
from .reference import MarkLayout, Marks, PlaneReference, find_reference
from .tags import Tag, TagFinder, single_tags

LOOKS = 12
"""Approximate number of looks at the reference over a video, and of pictures that are kept."""

# share of the pictures that may show two tags of the tip's id
_MOST_TWICE = 0.1

TAG_COLOUR = (60, 200, 60)
MARK_COLOUR = (230, 90, 230)
PLACE_COLOUR = (255, 200, 0)
"""Red, green and blue of what is drawn."""


@dataclass(frozen=True)
class TagScene:
    """What is in the pictures, and what is known of the camera."""

    tag: int  # id of the tag on the tip
    dictionary: str = DICTIONARY  # of the tags on the tip and around the arm
    # what lies on the desk, a board or tags at known places: positions are in its frame [m]
    board: CharucoPattern | None = None
    tags_at: MarkLayout | None = None
    lens: Lens | None = None  # the camera's
    # side of the tip's tag [m]; with it, z and the orientation are measured too
    tag_size: float | None = None
    # of the tip's tag above the board, or the tags on the desk [m]
    tag_height: float = 0.0

    def __post_init__(self) -> None:
        if refusal := self._refusal():
            raise OptionError(refusal)

    def _refusal(self) -> str:
        """Why the options contradict each other, or which one is missing; "" where all fit."""
        board = self.board
        marks = self.tags_at
        layout = self.layout
        if board is not None and marks is not None:
            return "`board` and `tags_at` are both given: expected one of them"
        if layout is not None and self.lens is None:
            return (
                "`board` or `tags_at` is given without `lens`: positions in metres may be off by "
                "centimetres; take 10 pictures of a board and give their folder as `lens`"
            )
        if layout is None and self.tag_height:
            return "`tag_height` is given without `board` or `tags_at`, above which it is measured"
        if self.tag_size is not None and self.lens is None:
            return "`tag_size` is for the tag's pose, which needs `lens`"
        others: Collection[int] = marks.points if marks else ()
        if board and board.dictionary.lower() == self.dictionary.lower():
            others = range(board.tags)
        if self.tag in others:
            return (
                f"tag {self.tag} is on the tip and in `tags_at`, or printed on the board too: take "
                "another id"
            )
        return ""

    @cached_property
    def layout(self) -> MarkLayout | None:
        """The frame of positions, if they are not pixels."""
        if self.board is None:
            return self.tags_at
        corners = dict(enumerate(self.board.corners()[:, :2]))
        return MarkLayout("the board", corners, LEAST_CORNERS)

    @cached_property
    def finder(self) -> TagFinder:
        """Finds the tip's tag and those on the desk."""
        marks = self.tags_at.points if self.tags_at else ()
        return TagFinder(self.dictionary, {self.tag, *marks})

    def marks(self, grey: Picture, tags: Sequence[Tag]) -> Marks:
        """Return what a picture shows of the reference."""
        if self.board is not None:
            return self.board.find(grey)
        numbers = self.tags_at.points if self.tags_at else ()
        return {
            tag.number: tag.centre
            for tag in single_tags(tags)
            if tag.number in numbers
        }


@dataclass(frozen=True, eq=False)
class Sightings:
    """What pictures show."""

    scene: TagScene
    what: str  # what messages call the pictures
    # the tag where it is sharp, by the picture's number
    tags: Mapping[int, Tag]
    names: Sequence[str]  # of these pictures
    # what some pictures show of the reference, by number
    marks: dict[int, Marks]
    reasons: Counter[str]  # why pictures have no tag, and how many
    count: int  # pictures in all
    size: tuple[int, int]  # width and height of the pictures [px]

    @cached_property
    def pixels(self) -> Array:
        """Places of the tag's centre (n, 2) [px]."""
        return np.array([tag.centre for tag in self.tags.values()])

    @cached_property
    def reference(self) -> tuple[PlaneReference | None, frozenset[int]]:
        """The frame of positions, None for pixels; and the pictures in which it is elsewhere.

        Raises LogError if it is not there, or elsewhere in many.
        """
        layout = self.scene.layout
        lens = self.scene.lens
        if layout is None or lens is None:
            return None, frozenset()
        return find_reference(layout, self.marks, lens, self.scene.tag_height)

    def document(self) -> dict[str, object]:
        """A log's description of pictures, tag, lens and reference, as plain values."""
        scene = self.scene
        reference, _ = self.reference
        frame = reference.to_json() if reference else {"kind": "pixels"}
        document: dict[str, object] = {
            "size": list(self.size),
            "tag": scene.tag,
            "dictionary": scene.dictionary,
            "reference": frame,
        }
        if scene.lens is not None:
            document["lens"] = scene.lens.to_json()
        return document


def find_sightings(
    shots: Iterable[Shot], scene: TagScene, what: str, every: int = 1
) -> Sightings:
    """Find the tag of the tip, and the marks of the reference, in pictures.

    what : what messages call the pictures
    every : the reference is searched in one of `every` pictures; some of these are kept, to list
        the tags that they show if this one is in none
    Raises LogError if the tag is there twice in more than a tenth, or nowhere.
    """
    sharp: dict[int, Tag] = {}
    names: list[str] = []
    marks: dict[int, Marks] = {}
    sample: list[Picture] = []
    reasons: Counter[str] = Counter()
    twice: list[str] = []
    count = 0
    for number, name, grey in shots:
        count += 1
        size = (grey.shape[1], grey.shape[0])
        refuse_size(scene.lens, size, name)
        tags = scene.finder.find(grey)
        if number % every == 0:
            if len(sample) < LOOKS:
                sample.append(grey)
            if scene.layout is not None:
                marks[number] = scene.marks(grey, tags)
        tips = [tag for tag in tags if tag.number == scene.tag]
        if not tips:
            reasons[f"tag {scene.tag} not seen"] += 1
        elif len(tips) > 1:
            reasons[f"tag {scene.tag} is there twice"] += 1
            twice.append(name)
        elif tips[0].sharp:
            sharp[number] = tips[0]
            names.append(name)
        else:
            reasons["blurred"] += 1
    if len(twice) > _MOST_TWICE * count:
        raise LogError(
            f"tag {scene.tag} is there twice in {len(twice)} of {count} {what} "
            f"({listing(twice, 3)}): cover one, or print another id for the tip"
        )
    if not sharp:
        raise LogError(
            f"tag {scene.tag} is in none of {count} {what}: {len(sample)} of them show "
            f"{_tags_of(sample, scene.dictionary)} of {scene.dictionary}; check the id, the "
            "dictionary, that it is sharp and has a white border"
        )
    return Sightings(scene, what, sharp, names, marks, reasons, count, size)


def _tags_of(pictures: Sequence[Picture], dictionary: str) -> str:
    """The tags that some pictures show, and in how many."""
    finder = TagFinder(dictionary)
    counts: Counter[int] = Counter()
    for grey in pictures:
        counts.update({tag.number for tag in finder.find(grey)})
    words = [f"{tag} ({times} times)" for tag, times in counts.most_common()]
    return listing(words, 6)


def write_overlay(
    path: FilePath,
    photo: Picture,
    scene: TagScene,
    places: Array,
) -> None:
    """Write a photo as PNG with its tags, its marks, and the tag's places in all rows of a log.

    The photo is red, green, blue; `places` (n, 2) [px] are those of the tag's centre.
    """
    cv2 = opencv()
    canvas = photo.copy()
    grey = cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY)
    tags = TagFinder(scene.dictionary).find(grey)
    if tags:
        corners = [tag.corners[None].astype(np.float32) for tag in tags]
        numbers = np.array([tag.number for tag in tags])
        cv2.aruco.drawDetectedMarkers(canvas, corners, numbers, TAG_COLOUR)
    corners_of_board = scene.marks(grey, ()).values()
    radius = max(3, round(max(canvas.shape) / 213))
    circles = ((PLACE_COLOUR, places), (MARK_COLOUR, corners_of_board))
    for colour, centres in circles:
        for centre in centres:
            middle = np.round(centre).astype(int).tolist()
            cv2.circle(canvas, middle, radius, colour, -1, cv2.LINE_AA)
    _, png = cv2.imencode(".png", canvas[:, :, ::-1])
    atomic_write(path, png.tobytes())
