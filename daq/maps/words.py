"""What names of other systems mean: usual words of English, German, French, Spanish, Italian and Japanese."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, replace

_CORNERS = {
    "fl": "fl lf vl avg frontleft leftfront vornelinks linksvorne avantgauche delizq antsx",
    "fr": "fr rf vr avd frontright rightfront vornerechts rechtsvorne avantdroit delder antdx",
    "rl": "rl lr hl arg rearleft leftrear backleft hintenlinks linkshinten arrieregauche trasizq postsx",
    "rr": "rr hr ard rearright rightrear backright hintenrechts rechtshinten arrieredroit trasder postdx",
}
_CORNER_OF = {word: corner for corner, words in _CORNERS.items() for word in words.split()}
_FRONT = {"front", "vorne", "vorn", "avant", "av", "ant", "del"}
_REAR = {"rear", "hinten", "arriere", "ar", "back", "post", "tras"}
_LEFT = {"left", "links", "gauche", "izq", "sx", "sinistra", "izquierda"}
_RIGHT = {"right", "rechts", "droite", "droit", "der", "dx", "destra", "derecha"}
_ACCEL = {"acc", "acel", "aceleracion", "accelerazione", "accelerometer", "a", "g"}
_RATE = {"rate", "gyro", "gyr", "gyroscope", "rotrate", "angularrate", "rot", "omega", "velocity", "vitesse", "vel",
         "geschw", "w", "drehrate", "angvel", "dot", "punkt"}  # fmt: skip
_X = {"x", "lon", "long", "longitudinal", "laengs", "longi", "forward", "inline"}
_Y = {"y", "lat", "lateral", "quer", "trans", "transv", "laterale"}
_Z = {"z", "vert", "vertical", "hoch", "verticale", "vertikal"}
_VELOCITY = {"vel", "velocity", "vitesse", "geschw"}
_UNIT = {"imu", "ahrs", "gyro"}
"""Words for an inertial unit."""
_GNSS = {"gps", "gnss", "ins", "vbox"}
_NO_MEANING = {
    "car",
    "vehicle",
    "fahrzeug",
    "kfz",
    "body",
    "aufbau",
    "sensor",
    "signal",
    "value",
    "wert",
    "pos",
    "fahr",
    "joint",
    "link",
}
"""Words that say nothing of the quantity."""
_NO_MEASUREMENT = {
    "accuracy", "valid", "status", "raw", "quality", "sigma", "std", "setpoint", "soll", "target", "cmd", "command",
    "desired", "covariance", "variance",
}  # fmt: skip
"""Words of names that are about a measurement, or ask for a value."""
_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue", "ß": "ss"})
_SPLIT = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_STEER = {"steer", "steering", "delta", "lenk", "spur", "toe", "braquage", "sterzo", "direccion"}
_STROKE = re.compile("pot|damper|shock|dämpfer|daempfer|amortis|ダンパ")
_COMPOUND = {
    # one word for two: word → the words it stands for
    "lataccel": "acc lat", "latacc": "acc lat", "longaccel": "acc long", "lonacc": "acc lon", "longacc": "acc long",
    "vertacc": "acc vert", "accx": "acc x", "accy": "acc y", "accz": "acc z", "ax": "acc x", "ay": "acc y",
    "az": "acc z", "gyrox": "gyro x", "gyroy": "gyro y", "gyroz": "gyro z", "wx": "rate x", "wy": "rate y",
    "wz": "rate z", "gx": "g x", "gy": "g y", "gz": "g z", "aq": "acc y", "psi": "yaw", "theta": "pitch",
    "yawrate": "yaw rate", "rollrate": "roll rate", "pitchrate": "pitch rate", "rollangle": "roll angle",
    "pitchangle": "pitch angle", "yawangle": "yaw angle", "lacet": "yaw", "roulis": "roll", "tangage": "pitch",
    "lenkradwinkel": "swa", "lenkwinkel": "swa", "lrw": "swa", "lenkrad": "swa", "steeringwheelangle": "swa",
    "steerwheelangle": "swa", "steeringangle": "swa", "steerangle": "swa", "volant": "swa", "anglevolant": "swa",
    "radlenkwinkel": "steer", "wheelsteer": "steer", "spurwinkel": "steer", "sturz": "camber", "gamma": "camber",
    "sturzwinkel": "camber", "carrossage": "camber", "caida": "camber", "fx": "force x", "fy": "force y",
    "fz": "force z", "mx": "moment x", "my": "moment y", "mz": "moment z", "kraft": "force", "radkraft": "force",
    "effort": "force", "fuerza": "force", "forza": "force", "drehmoment": "moment", "mom": "moment", "couple": "moment",
    "torque": "moment", "momento": "moment", "radlast": "force z", "aufstandskraft": "force z",
    "seitenkraft": "force y", "laengskraft": "force x", "querkraft": "force y", "wheelload": "force z",
    "federweg": "travel", "einfederung": "travel", "damperpot": "travel", "pot": "travel", "debattement": "travel",
    "susptravel": "travel", "susp": "travel", "suspension": "travel", "daempferweg": "travel", "wegsensor": "travel",
    "hoehenstand": "travel", "daempfer": "travel", "daempferkraft": "travel force", "recorrido": "travel",
    "shock": "travel", "damper": "travel", "drehzahl": "rotation", "raddrehzahl": "wheel rotation",
    "wheelspeed": "wheel speed", "whlspd": "wheel speed", "wspd": "wheel speed", "ws": "wheel speed",
    "rotspeed": "wheel rotation", "radgeschw": "wheel speed", "whl": "wheel", "rad": "wheel", "roue": "wheel",
    "rueda": "wheel", "spd": "speed", "vx": "velocity x", "vy": "velocity y", "vlon": "velocity x",
    "vlat": "velocity y", "geschwindigkeit": "speed", "geschw": "speed", "velocidad": "speed", "velocita": "speed",
    "vitesse": "speed", "velocity": "velocity", "vehspd": "speed", "vehiclespeed": "speed", "carspeed": "speed",
    "kfzgeschw": "speed", "heading": "course", "kurs": "course", "cap": "course", "latitude": "latitude",
    "longitude": "longitude", "breite": "latitude", "laenge": "longitude", "hgnd": "ground", "rideheight": "ground",
    "bodenabstand": "ground", "bodenfreiheit": "ground", "garde": "ground", "hauteur": "ground", "height": "ground",
    "rpm": "engine rotation", "nmot": "engine rotation", "regime": "engine rotation", "boden": "ground", "nabe": "hub",
    "moyeu": "hub", "v": "velocity", "motordrehzahl": "engine rotation", "enginespeed": "engine rotation",
    "throttle": "throttle", "tps": "throttle", "gaspedal": "throttle", "fahrpedal": "throttle",
    "bremsdruck": "brake pressure", "brakepressure": "brake pressure", "brakepress": "brake pressure",
    "pbrake": "brake pressure", "frein": "brake", "freno": "brake", "bremse": "brake", "press": "pressure",
    "druck": "pressure", "pression": "pressure", "druecke": "pressure", "winkel": "angle", "acceleration": "acc",
    "accel": "acc", "beschl": "acc", "beschleunigung": "acc", "altitude": "altitude", "hoehe": "altitude",
    "wank": "roll", "nick": "pitch", "gier": "yaw", "wanken": "roll", "nicken": "pitch", "gieren": "yaw",
    "angularvelocity": "rate", "angularvel": "rate", "angularrate": "rate", "linearacceleration": "acc",
    "linearaccel": "acc", "accelerationx": "acc x", "accelerationy": "acc y", "accelerationz": "acc z",
    "angularratex": "rate x", "angularratey": "rate y", "angularratez": "rate z", "rideh": "ground", "n": "rotation",
    "vit": "speed", "fahrbahnabstand": "ground", "fahrbahn": "ground", "raddrehwinkel": "wheel angle",
    "antriebsmoment": "drive moment", "bremsmoment": "brake moment", "antrieb": "drive", "antriebs": "drive",
    "brems": "brake", "halfshaft": "drive", "driveshaft": "drive", "shaft": "drive", "seitenwelle": "drive",
    "gelenkwelle": "drive", "vlong": "velocity x", "brk": "brake", "brkpress": "brake pressure", "hlaser": "ground",
}  # fmt: skip

_JAPANESE = {
    "左前輪": "fl", "右前輪": "fr", "左後輪": "rl", "右後輪": "rr", "前左輪": "fl", "前右輪": "fr", "後左輪": "rl",
    "後右輪": "rr", "左前": "fl", "右前": "fr", "左後": "rl", "右後": "rr", "前左": "fl", "前右": "fr", "後左": "rl",
    "後右": "rr", "ヨー": "yaw", "ロール": "roll", "ピッチ": "pitch", "レイト": "rate", "レート": "rate",
    "指令": "command", "目標": "target", "角速度": "rate", "加速度": "acc",
    "前後": "x", "左右": "y", "横": "y", "上下": "z", "輪荷重": "force z", "接地荷重": "force z",
    "荷重": "force z", "力": "force", "モーメント": "moment", "トルク": "moment", "回転速度": "rotation",
    "回転数": "rotation", "車輪速度": "wheel speed", "車輪速": "wheel speed", "車輪": "wheel", "車速": "speed",
    "速度": "speed", "操舵角": "swa", "ハンドル角": "swa", "ステアリング角": "swa", "操舵トルク": "swa moment",
    "舵角": "steer", "キャンバー": "camber", "キャンバ": "camber", "車高": "ground", "対地": "ground", "路面": "ground",
    "ダンパー": "damper", "ダンパ": "damper", "ストローク": "travel", "ブレーキ液圧": "brake pressure",
    "ブレーキ圧": "brake pressure", "ブレーキ": "brake", "制動": "brake", "駆動": "drive", "圧力": "pressure",
    "液圧": "pressure", "エンジン": "engine", "アクセル開度": "throttle", "スロットル": "throttle", "緯度": "latitude",
    "経度": "longitude", "高度": "altitude", "方位": "course", "角": "angle", "輪": "wheel",
}  # fmt: skip
_JAPANESE_WORD = re.compile("|".join(sorted(_JAPANESE, key=len, reverse=True)))
"""Any of them, a longer one before those that are parts of it."""


@dataclass(frozen=True)
class Meaning:
    """A column that a name could mean: how well the words fit, 0 to 1, and whether its sign is a convention.

    `by_unit` : only a unit that the log says makes it possible.
    """

    column: str
    words: float
    signed: bool = True
    by_unit: bool = False


_KNOWN = frozenset(
    {word for word in _COMPOUND if len(word) > 1} | {word for word in _CORNER_OF if len(word) > 1}
    | _FRONT | _REAR | _LEFT | _RIGHT | _UNIT | _GNSS | _NO_MEANING
    | {word for words in (_ACCEL, _RATE, _X, _Y, _Z, _STEER) for word in words if len(word) > 1}
    | {"speed", "force", "moment", "roll", "pitch", "yaw", "wheel", "engine", "brake", "camber", "hub", "course"}
)  # fmt: skip
"""Words of two letters or more that a run of letters may be made of."""


def _parts(word: str) -> list[str]:
    """The fewest known words that a run of letters is made of (fahrgeschwindigkeit, whlspdfl), or itself alone."""
    best: list[list[str] | None] = [[]] + [None] * len(word)
    for end in range(2, len(word) + 1):
        for begin in range(end - 1):
            before = best[begin]
            if before is not None and word[begin:end] in _KNOWN and len(before) + 1 < len(best[end] or word):
                best[end] = [*before, word[begin:end]]
    return best[-1] or [word]


def words_of(name: str) -> tuple[list[str], str]:
    """The words of a name in the lexicon's form, and the corner among them, empty for none."""
    plain = unicodedata.normalize("NFC", name.replace("_", " ")).translate(_UMLAUTS)
    if not plain.isascii():
        plain = _JAPANESE_WORD.sub(lambda word: f" {_JAPANESE[word[0]]} ", unicodedata.normalize("NFKC", plain))
    plain = unicodedata.normalize("NFKD", plain).encode("ascii", "ignore").decode()
    raw = [part for run in _SPLIT.findall(plain) for part in _parts(run.lower())]
    corner, kept = "", list[str]()
    joined = ["".join(raw[i : i + 2]) for i in range(len(raw) - 1)]
    for pair in joined:
        if pair in _CORNER_OF and not corner:
            corner = _CORNER_OF[pair]
    sides = [side for side, known in (("f", _FRONT), ("r", _REAR)) if known & set(raw)]
    hands = [hand for hand, known in (("l", _LEFT), ("r", _RIGHT)) if known & set(raw)]
    if not corner and len(sides) == len(hands) == 1:
        corner = sides[0] + hands[0]
    i = 0
    while i < len(raw):
        pair = raw[i] + raw[i + 1] if i + 1 < len(raw) else ""
        if pair in _COMPOUND:
            kept += _COMPOUND[pair].split()
            i += 2
            continue
        word = raw[i]
        found = _CORNER_OF.get(word)
        if found and (not corner or found == corner):
            corner = found
        elif word in _COMPOUND:
            kept += _COMPOUND[word].split()
        else:
            kept.append(word)
        i += 1
    return kept, corner


def meanings(name: str, quantity: str = "") -> list[Meaning]:
    """Columns that a name could mean, the best first; none where no word is known.

    `quantity` : words for what it is, where the log's format fixes it; of the name then only its last part counts.
    """
    whole = name.replace("/", ".")
    last = whole.rpartition(".")[2]
    kept, corner = words_of(last)
    corner = corner or words_of(whole)[1]
    if quantity:
        of_whole = set(words_of(whole)[0])
        if "velocity" in quantity and not corner and _GNSS & of_whole:
            return []  # in axes of the earth
        return _of_words({*kept, *quantity.split(), *(of_whole & _NO_MEASUREMENT - {"raw"})}, corner, name)
    return _of_words(set(kept), corner, name) or _of_words(set(words_of(whole)[0]), corner, name)


def _of_words(have: set[str], corner: str, name: str) -> list[Meaning]:
    out: list[Meaning] = []

    def add(column: str, words: float, signed: bool = True, by_unit: bool = False) -> None:
        out.append(Meaning(column.format(c=corner), words, signed, by_unit))

    axis = next((a for a, words in (("x", _X), ("y", _Y), ("z", _Z)) if words & have), "")
    if corner:
        if "force" in have and axis:
            add("wheel.{c}.force." + axis, 0.98, axis != "z")
        if "moment" in have and axis:
            add("wheel.{c}.moment." + axis, 0.98)
        if {"rotation", "rot"} & have or ("wheel" in have and "speed" in have):
            add("wheel.{c}.speed", 0.98, False)
        elif "speed" in have:
            add("wheel.{c}.speed", 0.9, False)
        elif have - _NO_MEANING == {"wheel"} or ({"wheel", "velocity"} <= have and not axis):  # the unit decides
            add("wheel.{c}.speed", 0.93, False)
        if "camber" in have:
            add("camera.{c}.camber", 0.97)
        elif (_STEER | {"swa"}) & have:  # a steering wheel has no corner
            add("camera.{c}.steer", 0.95)
        elif {"angle", "phi"} & have:
            add("wheel.{c}.angle", 0.95 if "wheel" in have else 0.9, False)
        if "moment" in have and not axis:
            for part, column in (("brake", "brake.{c}.torque"), ("drive", "shaft.{c}.torque")):
                if part in have:
                    add(column, 0.95)
        if "ground" in have and "hub" not in have:
            add("laser.{c}.ground", 0.95, False)
        if "travel" in have and "force" not in have:
            if _STROKE.search(name.lower()):  # not the wheel's travel: a motion ratio lies between
                add("damper.{c}.travel", 0.85)
            else:
                add("suspension.{c}.travel", 0.96)
        if {"travel", "force"} <= have and not axis:
            add("damper.{c}.force", 0.9)
        if _ACCEL & have and axis:
            add("hub.{c}.accel." + axis, 0.95)
        elif "hub" in have:
            add("laser.{c}.hub", 0.93, False)
        return out
    bare = have - _NO_MEANING - _GNSS
    turn = next((word for word in ("roll", "pitch", "yaw") if word in have), "roll" if "phi" in have else "")
    if turn:
        rate = bool(_RATE & have) or "speed" in have
        rate_of = "imu.rate." + {"roll": "x", "pitch": "y", "yaw": "z"}[turn]
        if rate:
            add(rate_of, 0.98)
        else:
            add(f"imu.attitude.{turn}", 0.95)
            add(rate_of, 0.93, by_unit=True)
    elif axis and _ACCEL & have:
        add(f"imu.accel.{axis}", 0.98, axis != "z")
        if "g" in have:  # gyro or g: the unit decides
            add(f"imu.rate.{axis}", 0.9)
    elif axis and _RATE & have and "velocity" not in have and "speed" not in have:
        add(f"imu.rate.{axis}", 0.96)
        if axis != "z" and _VELOCITY & have:  # the unit decides
            add(f"correvit.speed.{axis}", 0.93, axis == "y")
    elif axis in ("x", "y") and {"velocity", "speed", "correvit"} & have:
        add(f"correvit.speed.{axis}", 0.93, axis == "y")
    elif "moment" in have and (_STEER | {"swa"}) & have:
        add("steering.torque", 0.95)
    elif "swa" in have or (_STEER & have and ({"wheel", "angle"} & have)) or bare == {"steering"}:
        add("steering.angle", 0.96)
    elif ("speed" in have and "engine" not in have and "wheel" not in have) or bare == {"velocity"}:
        add("gnss.speed" if _GNSS & have or _GNSS & set(words_of(name)[0]) else "car.speed", 0.95, False)
    elif {"engine", "rotation"} <= have:
        add("engine.speed", 0.96, False)
    elif "throttle" in have:
        add("engine.throttle", 0.95, False)
    elif {"brake", "pressure"} <= have:
        add("brake.pressure", 0.95, False)
    elif "brake" in have and not axis:
        add("brake.pressure", 0.85, False, by_unit=True)
    elif have & {"latitude", "longitude", "altitude"}:
        add(f"gnss.{next(iter(have & {'latitude', 'longitude', 'altitude'}))}", 0.95, False)
    elif "course" in have and _UNIT & have:
        add("imu.attitude.yaw", 0.9)
    elif "course" in have:
        add("gnss.course", 0.85, False)
    return [replace(m, words=0.3 * m.words) for m in out] if have & _NO_MEASUREMENT else out
