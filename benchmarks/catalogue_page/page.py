from pathlib import Path
import json
PAGE=Path(__file__).parents[2]/"docs"/"catalogue.md"
PICTURES=PAGE.parent/"images"/"effects"
PICTURED=Path(__file__).with_name("pictured.json")
def pictured(): return json.loads(PICTURED.read_text()) if PICTURED.is_file() else {}
def page(): return ""
