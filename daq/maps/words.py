"""What names of other systems mean: the usual words and abbreviations, English, German, French, Spanish and Italian."""

from __future__ import annotations

import re
from dataclasses import dataclass

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
_ACCEL = {"acc", "accel", "acceleration", "beschl", "beschleunigung", "acel", "aceleracion", "accelerazione", "a"}
_RATE = {"rate", "gyro", "gyr", "rotrate", "angularrate", "rot", "omega", "velocity", "vitesse", "vel", "geschw", "w",
         "drehrate", "angvel"}  # fmt: skip
_X = {"x", "lon", "long", "longitudinal", "laengs", "längs", "longi", "forward"}
_Y = {"y", "lat", "lateral", "quer", "trans", "transv", "laterale"}
_Z = {"z", "vert", "vertical", "hoch", "verticale", "vertikal"}
_VELOCITY = {"vel", "velocity", "vitesse", "geschw"}
_UNIT = {"imu", "ahrs", "gyro"}
"""Words for an inertial unit."""
_GNSS = {"gps", "gnss", "ins", "vbox"}
_SPLIT = re.compile(r"[A-ZÄÖÜ]+(?![a-zäöüß])|[A-ZÄÖÜ]?[a-zäöüß]+|\d+")
_STEER = {"steer", "steering", "delta", "lenk", "spur", "toe", "braquage", "sterzo", "direccion"}
_STROKE = re.compile("pot|damper|shock|dämpfer|daempfer|amortis")
_COMPOUND = {
    # one word for two: word → the words it stands for
    "lataccel": "acc lat", "latacc": "acc lat", "longaccel": "acc long", "lonacc": "acc lon", "longacc": "acc long",
    "vertacc": "acc vert", "accx": "acc x", "accy": "acc y", "accz": "acc z", "ax": "acc x", "ay": "acc y",
    "az": "acc z",
    "gyrox": "gyro x", "gyroy": "gyro y", "gyroz": "gyro z", "wx": "rate x", "wy": "rate y", "wz": "rate z",
    "querbeschl": "acc lat", "querbeschleunigung": "acc lat", "laengsbeschl": "acc long", "längsbeschl": "acc long",
    "laengsbeschleunigung": "acc long", "längsbeschleunigung": "acc long", "hochbeschleunigung": "acc vert",
    "yawrate": "yaw rate", "rollrate": "roll rate", "pitchrate": "pitch rate", "gierrate": "yaw rate",
    "wankrate": "roll rate", "nickrate": "pitch rate", "giergeschw": "yaw rate", "giergeschwindigkeit": "yaw rate",
    "wankgeschwindigkeit": "roll rate", "nickgeschwindigkeit": "pitch rate", "vitesselacet": "yaw rate",
    "wankwinkel": "roll angle", "nickwinkel": "pitch angle", "gierwinkel": "yaw angle", "rollangle": "roll angle",
    "pitchangle": "pitch angle", "yawangle": "yaw angle", "lacet": "yaw", "roulis": "roll", "tangage": "pitch",
    "lenkradwinkel": "swa", "lenkwinkel": "swa", "lrw": "swa", "steeringwheelangle": "swa", "steerwheelangle": "swa",
    "steeringangle": "swa", "steerangle": "swa", "volant": "swa", "anglevolant": "swa", "radlenkwinkel": "steer",
    "wheelsteer": "steer", "spurwinkel": "steer", "sturz": "camber", "gamma": "camber", "sturzwinkel": "camber",
    "carrossage": "camber", "caida": "camber", "fx": "force x", "fy": "force y", "fz": "force z", "mx": "moment x",
    "my": "moment y", "mz": "moment z", "kraft": "force", "radkraft": "force", "effort": "force", "fuerza": "force",
    "forza": "force", "drehmoment": "moment", "mom": "moment", "couple": "moment", "torque": "moment",
    "momento": "moment",
    "radlast": "force z", "wheelload": "force z", "federweg": "travel", "einfederung": "travel", "damperpot": "travel",
    "pot": "travel", "debattement": "travel", "susptravel": "travel", "susp": "travel", "suspension": "travel",
    "daempferweg": "travel", "dämpferweg": "travel", "recorrido": "travel", "shock": "travel", "damper": "travel",
    "drehzahl": "rotation", "raddrehzahl": "wheel rotation", "wheelspeed": "wheel speed", "whlspd": "wheel speed",
    "wspd": "wheel speed", "ws": "wheel speed", "rotspeed": "wheel rotation", "radgeschw": "wheel speed",
    "whl": "wheel", "rad": "wheel", "roue": "wheel", "rueda": "wheel", "spd": "speed", "vx": "velocity x",
    "vy": "velocity y", "vlon": "velocity x", "vlat": "velocity y", "geschwindigkeit": "speed", "geschw": "speed",
    "velocidad": "speed", "velocita": "speed", "vitesse": "speed", "velocity": "velocity", "vehspd": "speed",
    "vehiclespeed": "speed", "carspeed": "speed", "kfzgeschw": "speed", "heading": "course", "kurs": "course",
    "cap": "course", "latitude": "latitude", "longitude": "longitude", "breite": "latitude", "laenge": "longitude",
    "hgnd": "ground", "rideheight": "ground", "bodenabstand": "ground", "bodenfreiheit": "ground", "garde": "ground",
    "hauteur": "ground", "height": "ground", "rpm": "engine rotation", "nmot": "engine rotation",
    "regime": "engine rotation", "boden": "ground", "nabe": "hub", "moyeu": "hub", "v": "velocity",
    "motordrehzahl": "engine rotation", "enginespeed": "engine rotation", "throttle": "throttle", "tps": "throttle",
    "gaspedal": "throttle", "fahrpedal": "throttle", "bremsdruck": "brake pressure", "brakepressure": "brake pressure",
    "brakepress": "brake pressure", "pbrake": "brake pressure", "frein": "brake", "freno": "brake", "bremse": "brake",
    "press": "pressure", "druck": "pressure", "pression": "pressure", "druecke": "pressure", "winkel": "angle",
    "phi": "angle", "acceleration": "acc", "accel": "acc", "beschl": "acc", "beschleunigung": "acc",
    "altitude": "altitude",
    "hoehe": "altitude", "wank": "roll", "nick": "pitch", "gier": "yaw", "wanken": "roll", "nicken": "pitch",
    "gieren": "yaw", "accelerationx": "acc x", "accelerationy": "acc y", "accelerationz": "acc z",
    "angularratex": "rate x", "angularratey": "rate y", "angularratez": "rate z", "rideh": "ground", "n": "rotation",
}  # fmt: skip


@dataclass(frozen=True)
class Meaning:
    """A column that a name could mean: how well the words fit, 0 to 1, and whether its sign is a convention."""

    column: str
    words: float
    signed: bool = True


def words_of(name: str) -> tuple[list[str], str]:
    """The words of a name in the lexicon's form, and the corner among them, empty for none."""
    raw = [part.lower() for part in _SPLIT.findall(name.replace("é", "e").replace("è", "e").replace("_", " "))]
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


def meanings(name: str) -> list[Meaning]:
    """Columns that a name could mean, the best first; none where no word is known."""
    whole = name.replace("/", ".")
    last = whole.rpartition(".")[2]
    kept, corner = words_of(last)
    corner = corner or words_of(whole)[1]
    return _of_words(set(kept), corner, name) or _of_words(set(words_of(whole)[0]), corner, name)


def _of_words(have: set[str], corner: str, name: str) -> list[Meaning]:
    out: list[Meaning] = []

    def add(column: str, words: float, signed: bool = True) -> None:
        out.append(Meaning(column.format(c=corner), words, signed))

    axis = next((a for a, words in (("x", _X), ("y", _Y), ("z", _Z)) if words & have), "")
    if corner:
        if "force" in have and axis:
            add("wheel.{c}.force." + axis, 0.98, axis != "z")
        if "moment" in have and axis:
            add("wheel.{c}.moment." + axis, 0.98)
        if {"rotation"} & have or ("wheel" in have and "speed" in have):
            add("wheel.{c}.speed", 0.98, False)
        elif "speed" in have:
            add("wheel.{c}.speed", 0.9, False)
        if "camber" in have:
            add("camera.{c}.camber", 0.97)
        elif (_STEER | {"swa"}) & have:  # a steering wheel has no corner
            add("camera.{c}.steer", 0.95)
        elif "angle" in have:
            add("wheel.{c}.angle", 0.9, False)
        if "ground" in have:
            add("laser.{c}.ground", 0.95, False)
        if "travel" in have and "force" not in have:
            # A potentiometer's stroke is not the wheel's: its ratio has to be said, and nothing here shows it.
            add("suspension.{c}.travel", 0.85 if _STROKE.search(name.lower()) else 0.96)
        if ({"hub"} & have) and not _ACCEL & have:
            add("laser.{c}.hub", 0.93, False)
        return out
    turn = next((word for word in ("roll", "pitch", "yaw") if word in have), "")
    if turn:
        rate = bool(_RATE & have) or "speed" in have
        if rate:
            add("imu.rate." + {"roll": "x", "pitch": "y", "yaw": "z"}[turn], 0.98)
        else:
            add(f"imu.attitude.{turn}", 0.95)
    elif axis and _ACCEL & have:
        add(f"imu.accel.{axis}", 0.98, axis != "z")
    elif axis and _RATE & have and "velocity" not in have and "speed" not in have:
        add(f"imu.rate.{axis}", 0.96)
        if axis != "z" and _VELOCITY & have:  # the unit decides
            add(f"correvit.speed.{axis}", 0.93, axis == "y")
    elif axis in ("x", "y") and {"velocity", "speed", "correvit"} & have:
        add(f"correvit.speed.{axis}", 0.93, axis == "y")
    elif "swa" in have or (_STEER & have and ({"wheel", "angle"} & have)):
        add("steering.angle", 0.96)
    elif "speed" in have and "engine" not in have and "wheel" not in have:
        add("gnss.speed" if _GNSS & have or _GNSS & set(words_of(name)[0]) else "car.speed", 0.95, False)
    elif {"engine", "rotation"} <= have:
        add("engine.speed", 0.96, False)
    elif "throttle" in have:
        add("engine.throttle", 0.95, False)
    elif {"brake", "pressure"} <= have:
        add("brake.pressure", 0.95, False)
    elif have & {"latitude", "longitude", "altitude"}:
        add(f"gnss.{next(iter(have & {'latitude', 'longitude', 'altitude'}))}", 0.95, False)
    elif "course" in have and _UNIT & have:
        add("imu.attitude.yaw", 0.9)
    elif "course" in have:
        add("gnss.course", 0.85, False)
    bad = have & {"accuracy", "valid", "status", "raw", "quality", "sigma", "std", "setpoint", "soll", "target"}
    return [Meaning(m.column, 0.3 * m.words, m.signed) for m in out] if bad else out
