"""Phrases that say in words that nothing touches, such as "not pressed" or "kein Kontakt", in several languages."""

from __future__ import annotations

import re

_NEGATIONS = (
    "not no non never without nicht kein keine keinen keinem keiner keinerlei ohne sans pas aucun aucune "
    "sin ningun ning\u00fan ninguna sem nenhum nenhuma n\u00e3o nao senza nessun nessuno nessuna niet "
    "geen zonder ikke ingen uden uten inte utan ei ilman nie brak bez ne nincs nem yok de\u011fil "
    "\u043d\u0435 \u043d\u0435\u0442 \u0431\u0435\u0437"
)
_TOUCHES = (  # the beginnings of words
    "touch contact press load finger object signal ber\u00fchr beruehr kontakt gedr\u00fcckt gedrueckt "
    "belast finger touch\u00e9 appui appuy contacto tocad toque pulsad presion presi\u00f3n contato "
    "tocand pression contatto toccat premut pressione aanrak aangeraakt ingedrukt ber\u00f8rt trykk "
    "r\u00f8rt ber\u00f6r tryck kosket dotyk dotkni naci\u015bni dotek stisk \u00e9rint nyom temas dokun "
    "bas\u0131l \u043a\u043e\u043d\u0442\u0430\u043a\u0442 \u043a\u0430\u0441\u0430\u043d "
    "\u043d\u0430\u0436\u0430\u0442 \u0442\u0440\u043e\u043d\u0443\u0442"
)
_ALONE = (
    "untouched unpressed unloaded nothing notouch nocontact nichts unbelastet ungedr\u00fcckt rien nada "
    "niente niets ingenting nic nichego \u043d\u0438\u0447\u0435\u0433\u043e "
    "\u0441\u0432\u043e\u0431\u043e\u0434\u043d\u043e \u0441\u0432\u043e\u0431\u043e\u0434\u043d\u0430 "
    "bo\u015f \u7a7a"
)
_FILLERS = frozenset(
    {
        "is",
        "was",
        "are",
        "at",
        "all",
        "de",
        "the",
        "a",
        "any",
        "there",
        "here",
        "now",
        "currently",
        "still",
        "being",
    }
    | {"es", "gibt", "est"}
)
_NOT = frozenset(_NEGATIONS.split())
_TOUCH = re.compile("|".join(sorted({*_TOUCHES.split()}, key=len, reverse=True)))
_WORDS = frozenset(_ALONE.split())
_OF_SIGNS = re.compile(  # of scripts that leave no blanks
    r"(?:\u672a|\u65e0|\u7121|\u6ca1\u6709|\u975e|\ubbf8|\ube44)\s?"
    r"(?:\u63a5\u89e6|\u89e6\u6478|\u6309\u4e0b|\uc811\ucd09|\ud130\uce58)"
    r"|(?:\u63a5\u89e6|\uc811\ucd09|\ud130\uce58)\s?(?:\u306a\u3057|\u7121\u3057|\uc5c6\uc74c|\uc548\s?\ub428)"
    r"|\uc5c6\uc74c|\u306a\u3057"
)


def says_no_contact(text: str) -> bool:
    """Return whether words say that nothing touches: a negation and a touch, and no other word.

    Examples
    --------
    >>> [says_no_contact(t) for t in ("not pressed", "kein Kontakt", "sin contacto", "nothing there")]
    [True, True, True, True]
    >>> [says_no_contact(t) for t in ("not connected", "no data", "pressed", "contact lost", "no")]
    [False, False, False, False, False]
    """
    text = " ".join(re.sub(r"[\s_.!\"'()\[\]<>-]+", " ", text.casefold()).split())
    words = [w for w in text.split() if w not in _FILLERS]
    if _OF_SIGNS.fullmatch(text) or (len(words) == 1 and words[0] in _WORDS):
        return True
    negated = [w for w in words if w in _NOT]
    return len(negated) == 1 and len(words) > 1 and all(w in _NOT or _TOUCH.match(w) for w in words)
