use std::collections::BTreeMap;

use egui::{Event, Key, KeyboardShortcut, Modifiers};
use serde::{Deserialize, Serialize};

use super::Action;

/// Keyboard shortcuts: the defaults, overridden by the user's changes.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Shortcuts {
    /// Differences from the defaults; `None` means no shortcut.
    changed: BTreeMap<Action, Option<KeyboardShortcut>>,
}

impl Shortcuts {
    /// Returns the shortcut of an action.
    #[must_use]
    pub fn keys(&self, action: Action) -> Option<KeyboardShortcut> {
        self.changed
            .get(&action)
            .copied()
            .unwrap_or_else(|| action.default_keys())
    }

    /// Sets the shortcut of an action and returns the action that lost it, if any.
    pub fn set(&mut self, action: Action, keys: KeyboardShortcut) -> Option<Action> {
        let holder = Action::all()
            .find(|&other| other != action && self.keys(other).is_some_and(|k| same(k, keys)));
        if let Some(holder) = holder {
            self.changed.insert(holder, None);
        }
        self.changed.insert(action, Some(keys));
        holder
    }

    /// Restores all defaults.
    pub fn reset(&mut self) {
        self.changed.clear();
    }

    /// Returns `true` if any shortcut differs from its default.
    #[must_use]
    pub fn is_changed(&self) -> bool {
        !self.changed.is_empty()
    }

    /// Returns pairs of actions with the same shortcut.
    ///
    /// It is empty unless a stored file was edited by hand.
    #[must_use]
    pub fn conflicts(&self) -> Vec<(Action, Action)> {
        let with_keys: Vec<_> = Action::all()
            .filter_map(|action| Some((action, self.keys(action)?)))
            .collect();
        let pairs = with_keys
            .iter()
            .enumerate()
            .flat_map(|(n, a)| with_keys[n + 1..].iter().map(move |b| (a, b)));
        pairs
            .filter(|(a, b)| same(a.1, b.1))
            .map(|(a, b)| (a.0, b.0))
            .collect()
    }

    /// Returns the action of a key press.
    #[must_use]
    pub fn action_for(&self, event: &Event) -> Option<Action> {
        let keys = pressed_keys(event)?;
        Action::all().find(|&action| self.keys(action).is_some_and(|own| same(own, keys)))
    }

    /// Returns the description of an action with its shortcut in brackets, for tooltips.
    #[must_use]
    pub fn tip(&self, ctx: &egui::Context, action: Action) -> String {
        match self.keys(action) {
            Some(keys) => format!("{} ({})", action.tip(), written(ctx, keys)),
            None => action.tip().into(),
        }
    }

    /// Returns the shortcut as text; empty if there is none.
    #[must_use]
    pub fn text(&self, ctx: &egui::Context, action: Action) -> String {
        self.keys(action)
            .map_or_else(String::new, |keys| written(ctx, keys))
    }
}

/// Returns the keys of a press. Repeats are ignored, except for keys that step through values.
pub(super) fn pressed_keys(event: &Event) -> Option<KeyboardShortcut> {
    let Event::Key {
        key,
        pressed: true,
        repeat,
        modifiers,
        ..
    } = event
    else {
        return None;
    };
    let repeatable = matches!(
        key,
        Key::ArrowLeft | Key::ArrowRight | Key::OpenBracket | Key::CloseBracket | Key::Z
    );
    (!repeat || repeatable).then_some(KeyboardShortcut::new(*modifiers, *key))
}

/// Formats keys as they are printed on a keyboard.
fn written(ctx: &egui::Context, keys: KeyboardShortcut) -> String {
    let sign = match keys.logical_key {
        Key::Questionmark => "?",
        Key::OpenBracket => "[",
        Key::CloseBracket => "]",
        Key::Escape => "Esc",
        _ => return ctx.format_shortcut(&keys),
    };
    ctx.format_shortcut(&keys)
        .replace(keys.logical_key.name(), sign)
}

/// Returns `true` if two shortcuts are the same keys.
///
/// Some keyboards need Shift to type a symbol such as `?`, so Shift is ignored there. Ctrl and the
/// Mac's Command key are equivalent.
fn same(a: KeyboardShortcut, b: KeyboardShortcut) -> bool {
    let shift_matters = !matches!(
        a.logical_key,
        Key::Questionmark | Key::Plus | Key::Colon | Key::Exclamationmark
    );
    let ctrl = |m: Modifiers| m.ctrl || m.command || m.mac_cmd;
    a.logical_key == b.logical_key
        && a.modifiers.alt == b.modifiers.alt
        && ctrl(a.modifiers) == ctrl(b.modifiers)
        && (!shift_matters || a.modifiers.shift == b.modifiers.shift)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn press(key: Key, modifiers: Modifiers) -> Event {
        Event::Key {
            key,
            physical_key: None,
            pressed: true,
            repeat: false,
            modifiers,
        }
    }

    #[test]
    fn defaults_do_not_conflict() {
        assert_eq!(Shortcuts::default().conflicts(), []);
    }

    #[test]
    fn modifiers_distinguish_actions() {
        let shortcuts = Shortcuts::default();
        let ctrl = Modifiers {
            ctrl: true,
            command: true,
            ..Modifiers::NONE
        };
        assert_eq!(
            shortcuts.action_for(&press(Key::Z, ctrl)),
            Some(Action::Undo)
        );
        assert_eq!(
            shortcuts.action_for(&press(Key::Z, ctrl | Modifiers::SHIFT)),
            Some(Action::Redo)
        );
        assert_eq!(
            shortcuts.action_for(&press(Key::ArrowLeft, Modifiers::SHIFT)),
            Some(Action::Back10)
        );
        assert_eq!(
            shortcuts.action_for(&press(Key::Questionmark, Modifiers::SHIFT)),
            Some(Action::ShortcutSheet)
        );
        assert_eq!(
            shortcuts.action_for(&press(Key::F24, Modifiers::NONE)),
            None
        );
    }

    #[test]
    fn changing_a_shortcut_takes_it_from_its_previous_action() {
        let mut shortcuts = Shortcuts::default();
        let q = KeyboardShortcut::new(Modifiers::NONE, Key::Q);
        assert_eq!(shortcuts.set(Action::Fuse, q), Some(Action::IncludeHere));
        assert_eq!(shortcuts.keys(Action::Fuse), Some(q));
        assert_eq!(shortcuts.keys(Action::IncludeHere), None);
        assert_eq!(shortcuts.conflicts(), []);
        shortcuts.reset();
        assert_eq!(shortcuts, Shortcuts::default());
    }
}
