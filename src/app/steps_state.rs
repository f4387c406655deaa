//! Which step of the way from frames to measures is open.

use ostra_project::workflow::WorkflowStep;

/// Which step is open, and where the panel is.
#[derive(Debug, Clone, Default)]
pub struct StepsState {
    /// Open step; `None` while all are closed.
    pub open: Option<WorkflowStep>,
    /// Step that was recommended when the window was last drawn.
    recommended: Option<WorkflowStep>,
    /// Whether the user opened a step other than the recommended one, or closed it.
    is_chosen: bool,
    /// Whether side panel, timeline and filmstrip are hidden.
    pub is_bare: bool,
    /// Whether a click in a narrow window expanded the panel.
    pub is_expanded: bool,
    /// Whether the panel is shown, so that inspector and selection are in it.
    pub(crate) is_docked: bool,
}

impl StepsState {
    /// Opens the recommended step when it changes, unless the user chose another.
    pub(crate) fn follow(&mut self, next: WorkflowStep) {
        if self.recommended.replace(next) != Some(next) && !self.is_chosen {
            self.open = Some(next);
        }
    }

    /// Opens a step, or closes it if it is open.
    pub(crate) fn toggle(&mut self, step: WorkflowStep) {
        self.open = (self.open != Some(step)).then_some(step);
        self.is_chosen = self.open != self.recommended;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recommended_step_opens_by_itself_unless_another_was_chosen() {
        let mut state = StepsState::default();
        state.follow(WorkflowStep::Label);
        assert_eq!(state.open, Some(WorkflowStep::Label));
        state.follow(WorkflowStep::Track);
        assert_eq!(state.open, Some(WorkflowStep::Track));
        state.toggle(WorkflowStep::Cloud);
        state.follow(WorkflowStep::Geometry);
        assert_eq!(state.open, Some(WorkflowStep::Cloud), "chosen by the user");
        state.toggle(WorkflowStep::Geometry);
        state.follow(WorkflowStep::Cloud);
        assert_eq!(
            state.open,
            Some(WorkflowStep::Cloud),
            "the user follows again"
        );
    }
}
