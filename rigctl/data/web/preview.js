// One picture after the other, each asked for once the one before is there: a slow link gets fewer, never late ones.
"use strict";
const picture = document.getElementById("picture"), lost = document.getElementById("lost");
let number = 0;
document.documentElement.dataset.look = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
async function next() {
  try {
    const answer = await fetch(`/picture.jpg?after=${number}`, { signal: AbortSignal.timeout(10000) });
    const newest = Number(answer.headers.get("x-number"));
    if (answer.ok && newest !== number) {
      const old = picture.src;
      picture.src = URL.createObjectURL(await answer.blob());
      if (old) URL.revokeObjectURL(old);
      number = newest;
      document.getElementById("told").textContent = answer.headers.get("x-told");
    }
    lost.hidden = answer.ok;
    setTimeout(next, answer.ok ? 0 : 1000);
  } catch (error) { lost.hidden = false; setTimeout(next, 1000); }
}
next();
