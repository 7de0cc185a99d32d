"""What the trials found, kept between runs of the command."""

import json

KILLED, SURVIVED, BROKEN, EQUIVALENT = "killed", "survived", "broken", "equivalent"


class Results:
    """A file of results; each belongs to one wording of its entry."""

    def __init__(self, path):
        self.path = path
        self.found = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}

    def of(self, mutant):
        """Give what was found for `mutant`, None if it was not run in this wording."""
        if mutant.equivalent:
            return EQUIVALENT
        found, digest = self.found.get(mutant.name, (None, None))
        return found if digest == mutant.digest else None

    def keep(self, mutant, found):
        """Keep what was found, on disk too."""
        self.found[mutant.name] = (found, mutant.digest)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.path.write_text(json.dumps(self.found, indent=0, sort_keys=True), encoding="utf-8")
