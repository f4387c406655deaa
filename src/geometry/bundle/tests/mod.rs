mod behaviour;
mod jacobians;
mod recovery;
mod scene;
mod solving;
