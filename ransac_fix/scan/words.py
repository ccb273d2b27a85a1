"""The words that tell RANSAC code from other uses of the same algebra.

``log(1-s) / log(1-w**k)`` also sizes a Bloom filter or a set of LSH bands, so a rule is reported
only where something says RANSAC. Names lie, so words never decide what a rule is: they only raise
or lower how sure we are that it is one, and silence it where nothing speaks for it.
"""

import re

_STRONG_WORDS = (
    *("ransac", "inlier", "outlier", "consensus", "msac", "prosac"),
    *("lmeds", "least median", "mlesac", "magsac"),
)
# The problems that it solves, and inliers as many spell them; written as one word or as two.
_WEAK_PHRASES = (
    *("homograph", "epipol", "keypoint", "inliners", "point cloud"),
    *("vanishing point", "fundamental mat", "essential mat"),
)
_WEAK_WORDS = tuple(
    dict.fromkeys(
        phrase.replace(" ", between) for phrase in _WEAK_PHRASES for between in ("", " ", "_")
    )
)
# Spelled out: without case, itemsAccount has an msac in it.
_STRONG = re.compile(
    "|".join(
        dict.fromkeys(
            spelling
            for word in _STRONG_WORDS
            for spelling in (word, word.upper(), word.capitalize(), word.title())
        )
    )
    + "|RanSaC|RanSac|MSaC|LMedS|InLier|OutLier"
)
WORDS = tuple(word.encode() for word in (*_STRONG_WORDS, *_WEAK_WORDS))
_OTHER = re.compile(
    r"bloom|min_?hash|jaccard|\blsh|false.positive|pass@|pass_at_k|annealing|time.to.solution"
    r"|differential.privacy|k-?mers?\b|allele|genotype|bonferroni|family.?wise|geometric dist",
    re.IGNORECASE,
)


def is_ransac(name: str) -> bool:
    """Whether a name is of RANSAC itself or one of its kin."""
    return "ransac" in name.lower() or "consensus" in name.lower()


def speaks_strongly(text: str) -> bool:
    """Whether a text uses a word that is of RANSAC alone."""
    return bool(_STRONG.search(text))


def speaks_weakly(text: str) -> bool:
    """Whether a text is about the problems that RANSAC is used for."""
    lowered = text.lower()
    return any(word in lowered for word in _WEAK_WORDS)


def speaks_of_other(text: str) -> bool:
    """Whether a text is about another use of the same algebra."""
    return bool(_OTHER.search(text))


def in_lowered(lowered: bytes) -> bool:
    """Whether a file, in lower case, could speak for RANSAC at all."""
    return any(word in lowered for word in WORDS)
