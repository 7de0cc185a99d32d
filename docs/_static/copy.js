// A button on every block of code that copies it; of an interpreter's session only what was typed.
"use strict";

const PROMPT = /^(>>>|\.\.\.) ?/;

const typed = (text) => {
  const lines = text.replace(/\n$/, "").split("\n");
  if (!lines.some((line) => line.startsWith(">>> "))) return text;
  return lines.filter((line) => PROMPT.test(line)).map((line) => line.replace(PROMPT, "")).join("\n");
};

const copied = async (text) => {
  if (navigator.clipboard) return navigator.clipboard.writeText(text);
  // a page that was opened from a disk has no clipboard of its own in some browsers
  const field = document.createElement("textarea");
  field.value = text;
  document.body.append(field);
  field.select();
  document.execCommand("copy");
  field.remove();
};

document.addEventListener("DOMContentLoaded", () => {
  for (const code of document.querySelectorAll("div.highlight pre")) {
    const block = code.closest("div.highlight");
    const output = block.closest(".cell_output, .highlight-text, .highlight-none");
    if (output) continue;
    const button = document.createElement("button");
    button.className = "copy";
    button.type = "button";
    button.textContent = "Copy";
    button.onclick = async () => {
      await copied(typed(code.textContent));
      button.textContent = "Copied";
      setTimeout(() => { button.textContent = "Copy"; }, 1500);
    };
    block.append(button);
  }
});
