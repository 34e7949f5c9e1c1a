// A run from the page: how far it is, then its table, its replay and its report.

async function followRun(editor) {
  const box = byId("answer");
  showingAnswer(editor, true);
  const bar = element("progress", { aria: { "aria-label": "Runs" } });
  const text = element("p", { aria: { role: "status" } });
  const stop = button("Stop", () => editor.ask("stop", {}));
  box.replaceChildren(element("div", { className: "head" }, [element("h2", { textContent: "Running" }), bar, text, stop]));
  const begin = Date.now();
  for (;;) {
    const found = await editor.ask("progress", {});
    const seconds = Math.round((Date.now() - begin) / 1000);
    if (found.failed || found.state === "failed") {
      box.replaceChildren(element("div", { className: "head" }, [
        element("h2", { textContent: "The run has stopped" }), element("p", { className: "problem", textContent: found.failed || found.said }), closing(editor),
      ]));
      return;
    }
    if (found.state === "done") return showAnswer(editor, found);
    bar.max = found.runs;
    if (found.done) bar.value = found.done;
    text.textContent = found.done < found.runs ? `${found.done} of ${found.runs} evacuations, ${seconds} s` : `drawing replay and report, ${seconds} s`;
    await new Promise((later) => setTimeout(later, 400));
  }
}

function showAnswer(editor, found) {
  const rows = found.rows.map(([label, cell]) => element("tr", {}, [element("th", { textContent: label, scope: "row" }), element("td", { textContent: cell })]));
  const doubts = found.check ? [element("p", { className: "doubt", textContent: `check: ${found.check}` })] : [];
  const frame = element("iframe", { src: "replay.html", title: "Replay of the first run" });
  const tabs = [["Replay", "replay.html"], ["Report", "report.html"]].map(([word, page]) =>
    button(word, () => {
      frame.src = page;
      frame.title = word;
      tabs.forEach((tab) => tab.setAttribute("aria-pressed", String(tab.textContent === word)));
    }, { aria: { "aria-pressed": String(word === "Replay") } }));
  byId("answer").replaceChildren(
    element("div", { className: "head" }, [
      element("div", { className: "row" }, [...tabs, element("a", { href: "report.html", target: "_blank", textContent: "Report on its own" }), closing(editor)]),
    ]), frame, element("div", { className: "rows" }, [...doubts, element("table", {}, rows)]),
  );
  editor.say(`${found.runs} evacuations are kept in ${found.folder}`);
}

function showingAnswer(editor, on) {
  byId("answer").hidden = !on;
  byId("answer").parentElement.classList.toggle("answered", on);
  if (!on) byId("canvas").focus();
}

const closing = (editor) => button("Back to the plan", () => showingAnswer(editor, false));
