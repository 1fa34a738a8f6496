/** Files of the study replaced and deleted: asked about first, with what no longer fits together afterwards. */

import { h } from "../widgets/dom.js";

/**
 * Asks before a file is replaced or deleted.
 * @param {object} app
 * @param {string} name of a run, or rig.toml, vehicle.toml
 * @param {"Delete"|"Replace"} verb
 * @returns {Promise<boolean>} whether to go on
 */
export async function confirmed(app, name, verb) {
  const found = await app.api.get(`api/runs/${encodeURIComponent(name)}/consequences`);
  const says = [...found.says, "The file is not lost: it is moved to the study's folder “removed”."];
  const no = verb === "Delete" && !found.may_remove;
  return new Promise((done) => {
    const answer = (yes) => () => {
      dialog.close();
      done(yes);
    };
    const dialog = h("dialog", { class: "ask", "aria-labelledby": "ask-title", "data-testid": "ask", oncancel: () => done(false), onclose: () => dialog.remove() },
      h("h2", { id: "ask-title", text: no ? `${name} cannot be deleted` : `${verb} ${found.files.join(", ")}?` }),
      h("ul", null, (no ? found.says : says).map((text) => h("li", { text: `${text}${text.endsWith(".") ? "" : "."}` }))),
      h("div", { class: "bar" },
        no ? null : h("button", { type: "button", class: "danger", "data-testid": "ask-yes", onclick: answer(true), text: verb }),
        h("button", { type: "button", "data-testid": "ask-no", autofocus: true, onclick: answer(false), text: no ? "Close" : "Keep it" })));
    document.body.append(dialog);
    dialog.showModal();
  });
}

/**
 * Buttons that replace and delete a file.
 * @param {object} app
 * @param {{name: string, file: string, may?: boolean}} what `may` : whether there is one to delete
 * @param {{replace: (file: File, as: string) => void, done: () => void}} act
 * @returns {HTMLElement}
 */
export function fileActions(app, { name, file, may = true }, { replace, done }) {
  const pick = h("input", { type: "file", class: "sr", tabindex: "-1", "aria-hidden": "true", "data-testid": `replace-file-${name}`,
    accept: file.slice(file.lastIndexOf(".")), onchange: () => {
      if (pick.files.length) replace(pick.files[0], file);
      pick.value = "";
    } });
  const go = (verb, then) => async () => {
    try {
      if (await confirmed(app, name, verb)) await then();
    } catch (cause) {
      app.complain(cause);
    }
  };
  const remove = go("Delete", async () => {
    await app.api.remove(`api/runs/${encodeURIComponent(name)}`);
    app.toast(`${name} is out of the study's runs; its file is in the study's folder “removed”.`, "good");
    done();
  });
  const button = (verb, text, onclick) => h("button", { type: "button", class: "small quiet", "data-testid": `${verb}-${name}`, "aria-label": `${text} ${name}`, onclick, text });
  return h("span", { class: "file-actions" }, button("replace", "Replace", go("Replace", async () => pick.click())),
    may ? button("delete", "Delete", remove) : null, pick);
}
