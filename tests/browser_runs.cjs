// Writes the columns of runs as doubles: node browser_runs.cjs FOLDER < runs.json
const fs = require("fs");
const path = require("path");
const folder = path.resolve(process.argv[2]);
const { COLUMNS, loadModel } = require(path.join(folder, "model.js"));
const runs = JSON.parse(fs.readFileSync(0, "utf8"));
loadModel(fs.readFileSync(path.join(folder, "zivi.wasm"))).then((model) => {
  for (const [system, settings, signs, n] of runs) {
    const run = model[system](settings, signs, n);
    for (const name of ["t", ...COLUMNS]) fs.writeSync(1, Buffer.from(run[name].buffer));
  }
});
