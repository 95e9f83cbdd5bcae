classdef arm < trocar.instance & trocar.joints
    % An arm of a running system, with the names of CRTK.
    %
    %   psm = trocar.arm('PSM1');                          % the bridge of this machine, 127.0.0.1:7380
    %   psm = trocar.arm('PSM1', 'robot.lab:7380', 'token');
    %   psm = trocar.arm('PSM1', b);                       % by a trocar.bridge that others use, too
    %
    % Poses are 4x4 matrices in the reference frame, those of `local` in the arm's base; joints are columns of rad and
    % m, twists and wrenches 1x6, linear first. Commands return when the arm has accepted them. `frame`: that of the
    % numbers of a command, e.g. 'PSM1_base', as over ROS (docs/ros.md); by default, the reference frame.

    properties (SetAccess = protected)
        body     % forces and Jacobian seen from the tip
        spatial  % the same from the origin of the arm's base
        local    % the tip in the arm's base
        gravity_compensation  % setpoint_js and setpoint_jf that bear the arm's weight
    end

    methods

        function self = arm(name, varargin)
            % trocar:lost when nobody is there, trocar:argument when there is no such arm.
            self@trocar.instance(name, varargin{:});
            self@trocar.joints([], [name '/']);
            self.joints_of = self.bridge;
            self.body = trocar.frame(self.bridge, name, 'body');
            self.spatial = trocar.frame(self.bridge, name, 'spatial');
            self.local = trocar.local(self.bridge, name);
            self.gravity_compensation = trocar.joints(self.bridge, [name '/gravity_compensation/']);
        end

        % the tip

        function [pose, timestamp] = measured_cp(self)
            % Measured pose of the tip.
            [pose, timestamp] = self.bridge.pose([self.name '/measured_cp']);
        end

        function [pose, timestamp] = setpoint_cp(self)
            % Setpoint of the tip.
            [pose, timestamp] = self.bridge.pose([self.name '/setpoint_cp']);
        end

        function [twist, timestamp] = measured_cv(self)
            % Measured twist of the tip.
            [twist, timestamp] = self.bridge.six([self.name '/measured_cv'], 'linear', 'angular');
        end

        function [twist, timestamp] = setpoint_cv(self)
            % Twist of the setpoint.
            [twist, timestamp] = self.bridge.six([self.name '/setpoint_cv'], 'linear', 'angular');
        end

        function [wrench, timestamp] = measured_cf(self)
            % The same as body.measured_cf.
            [wrench, timestamp] = self.body.measured_cf();
        end

        function handle = move_cp(self, pose, frame)
            % Move to a pose of the tip, joints in a straight line: a trocar.move_handle.
            if nargin < 3, frame = ''; end
            handle = self.bridge.move(self.name, 'move_cp', trocar.internal.numbers_of(pose), frame);
        end

        function handle = move_cr(self, change, frame)
            % Move the tip by a shift and a turn about itself (4x4).
            if nargin < 3, frame = ''; end
            handle = self.bridge.move(self.name, 'move_cr', trocar.internal.numbers_of(change), frame);
        end

        function servo_cp(self, pose, twist, frame)
            % Follow a pose of the tip now, with its twist where given ([]: none).
            values = trocar.internal.numbers_of(pose);
            if nargin > 2 && ~isempty(twist)
                values = [values, trocar.internal.sized(twist, 6, 'a twist')];
            end
            if nargin < 4, frame = ''; end
            self.command('servo_cp', values, frame);
        end

        function servo_cr(self, change, frame)
            % Follow the setpoint, shifted and turned about its tip (4x4).
            if nargin < 3, frame = ''; end
            self.command('servo_cr', trocar.internal.numbers_of(change), frame);
        end

        function servo_cs(self, pose, twist, wrench, frame)
            % Follow a pose with its twist and wrench; [] for what is not given. Without a pose: apply the wrench.
            values = zeros(1, 22);
            if nargin > 1 && ~isempty(pose)
                values(1:7) = trocar.internal.numbers_of(pose);
                values(20) = 1;
            end
            if nargin > 2 && ~isempty(twist)
                values(8:13) = trocar.internal.sized(twist, 6, 'a twist');
                values(21) = 1;
            end
            if nargin > 3 && ~isempty(wrench)
                values(14:19) = trocar.internal.sized(wrench, 6, 'a wrench');
                values(22) = 1;
            end
            if nargin < 5, frame = ''; end
            self.command('servo_cs', values, frame);
        end

        function servo_cf(self, wrench, varargin)
            % The same as body.servo_cf.
            self.body.servo_cf(wrench, varargin{:});
        end

        function servo_ci(self, impedance, frame)
            % Push as springs and dampers do, see trocar.impedance; for 0.1 s, unless sent again.
            if nargin < 3, frame = ''; end
            self.command('servo_ci', impedance.numbers(), frame);
        end

        % joints

        function handle = move_jp(self, jp)
            % Move to these positions of the joints and stop there: a trocar.move_handle.
            handle = self.bridge.move(self.name, 'move_jp', jp);
        end

        function handle = move_jr(self, jr)
            % Move by these increments.
            handle = self.bridge.move(self.name, 'move_jr', jr);
        end

        function servo_jp(self, jp, jv)
            % Follow these positions now, with their velocities where given.
            values = jp(:).';
            if nargin > 2, values = [values, jv(:).']; end
            self.command('servo_jp', values);
        end

        function servo_jr(self, jr)
            % Follow the setpoint plus these increments.
            self.command('servo_jr', jr);
        end

        function servo_jv(self, jv)
            % Go at these velocities until 0.1 s after the last such command.
            self.command('servo_jv', jv);
        end

        function servo_jf(self, jf)
            % Apply these efforts for 0.1 s, zeros until another command.
            self.command('servo_jf', jf);
        end

        function hold(self)
            % End motion and hold the setpoint. Powered but not homed: pauses; state_command resume continues.
            self.command('hold', []);
        end

        function free(self)
            % Zero efforts but for the arm's weight; it can be moved by hand.
            self.command('free', []);
        end

        function result = pause(self, timeout)
            % Pause and wait until it is PAUSED; moves end.
            if nargin < 2, timeout = 10; end
            self.state_command('pause');
            result = self.wait_for_operating_state('PAUSED', timeout);
        end

        function result = resume(self, timeout)
            % Go on after a pause and wait until it is ENABLED.
            if nargin < 2, timeout = 10; end
            self.state_command('resume');
            result = self.wait_for_operating_state('ENABLED', timeout);
        end

        % settings

        function trajectory_j_set_ratio(self, ratio)
            % Speed and acceleration of moves, above 0 up to 1.
            self.command('trajectory_j/set_ratio', ratio);
        end

        function trajectory_j_set_ratio_v(self, ratio)
            % Speed alone.
            self.command('trajectory_j/set_ratio_v', ratio);
        end

        function trajectory_j_set_ratio_a(self, ratio)
            % Acceleration alone.
            self.command('trajectory_j/set_ratio_a', ratio);
        end

        function ratio = trajectory_j_get_ratio(self)
            % The ratio in use; 0: speed and acceleration differ.
            row = self.state();
            ratio = row.trajectory_ratio;
        end

        function ratio = trajectory_j_get_ratio_v(self)
            % That of the speed.
            row = self.state();
            ratio = row.trajectory_ratio_v;
        end

        function ratio = trajectory_j_get_ratio_a(self)
            % That of the acceleration.
            row = self.state();
            ratio = row.trajectory_ratio_a;
        end

        function ratio = trajectory_j_ratio(self)
            % The same, as dvrk_matlab calls it.
            ratio = self.trajectory_j_get_ratio();
        end

        function use_gravity_compensation(self, on)
            % Bear the arm's own weight, or don't.
            self.command('use_gravity_compensation', trocar.internal.flag(on));
        end

        function set_base_frame(self, pose, frame)
            % Pose (4x4) of the arm's base in a reference frame of this name; []: unknown, only `local` is valid.
            if nargin < 3, frame = ''; end
            values = [];
            if ~isempty(pose)
                values = trocar.internal.numbers_of(pose);
            end
            self.bridge.command(self.name, 'set_base_frame', values, frame);
        end

        function add_wall(self, name, shape, pose, sizes, margin, words)
            % Keep a part of the arm out of a shape at a pose (4x4); words of docs/walls.md, e.g. 'in tip reference'.
            if nargin < 5, sizes = []; end
            if nargin < 6, margin = 0; end
            if nargin < 7, words = ''; end
            values = [reshape(trocar.internal.numbers_of(pose), 1, []), reshape(sizes, 1, []), margin];
            self.bridge.command(self.name, 'add_wall', values, strtrim([name ' ' shape ' ' words]));
        end

        function remove_wall(self, name)
            % Remove a wall; an operator's command.
            self.bridge.command(self.name, 'remove_wall', [], name);
        end

        function frame = reference_frame(self)
            % Name of the frame that poses are given in.
            row = self.state();
            frame = row.reference_frame;
        end

        % questions; nothing moves

        function pose = forward_kinematics(self, jp)
            % Pose of the tip at these joints.
            pose = trocar.internal.matrix_of(trocar.internal.asked(self.bridge, self.name, 'forward_kinematics', jp));
        end

        function jp = inverse_kinematics(self, seed, pose)
            % Joints for a pose of the tip in the arm's base, near the seed; trocar:refused where there are none.
            values = [seed(:).', trocar.internal.numbers_of(pose)];
            jp = trocar.internal.asked(self.bridge, self.name, 'inverse_kinematics', values);
        end

        function jp = actuator_to_joint_position(self, positions)
            % Joint positions for positions of all actuators.
            jp = trocar.internal.asked(self.bridge, self.name, 'actuator_to_joint_position', positions);
        end

        function version = crtk_version(self)
            % Version of the commands' meaning.
            version = self.bridge.command(self.name, 'crtk_version');
        end

    end

    methods (Access = protected)

        function command(self, name, values, varargin)
            self.bridge.command(self.name, name, values, varargin{:});
        end

    end

end
