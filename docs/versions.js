// A menu of the versions that are beside this one, above the search. `versions.list.js` there names them.
document.addEventListener("DOMContentLoaded", () => {
  const search = document.querySelector(".sidebar-search-container");
  const root = document.documentElement.dataset.content_root;
  const list = document.createElement("script");
  list.src = root + "../versions.list.js";
  list.onload = () => {
    const menu = document.createElement("select");
    menu.setAttribute("aria-label", "Version of these pages");
    menu.className = "versions";
    for (const version of window.srlVersions) {
      const option = new Option("Version " + version, version);
      option.selected = new URL(root, location).pathname.endsWith("/" + version + "/");
      menu.add(option);
    }
    menu.onchange = () => {
      location = new URL(root + "../" + menu.value + "/index.html", location);
    };
    search.before(menu);
  };
  document.head.append(list);
});
