classdef teleop < trocar.operated
    % One teleoperation: trocar.teleop('MTMR_PSM1').

    methods

        function self = teleop(name, varargin)
            % trocar:argument when there is none of this name.
            self@trocar.operated(name, 'teleop', varargin{:});
        end

        function state = current_state(self)
            % DISABLED, SETTING_ARMS_STATE, ALIGNING_MTM or ENABLED.
            row = self.state();
            state = row.state;
        end

        function state = desired_state(self)
            % The state asked for.
            row = self.state();
            state = row.desired_state;
        end

        function result = following(self)
            % Whether the slave follows.
            row = self.state();
            result = logical(row.following);
        end

        function text = reason(self)
            % What it waits for, or why it does not follow; empty: nothing.
            row = self.state();
            text = row.reason;
        end

        function state_command(self, word)
            % enable, align_MTM or disable.
            self.command('state_command', [], word);
        end

        function result = enable(self, timeout)
            % Ask for it and wait until it is ENABLED: its arms are homed and aligned, and the operator is there.
            if nargin < 2, timeout = 60; end
            self.state_command('enable');
            result = self.wait_for_state('ENABLED', timeout);
        end

        function result = disable(self, timeout)
            % End it and wait until it is DISABLED.
            if nargin < 2, timeout = 10; end
            self.state_command('disable');
            result = self.wait_for_state('DISABLED', timeout);
        end

        function result = wait_for_state(self, state, timeout)
            % Until that is its state; trocar:timeout after `timeout` s (10).
            if nargin < 3, timeout = 10; end
            trocar.internal.wait_until(@() strcmp(self.current_state(), state), self.bridge, self.name, timeout, ...
                                  [self.name ' is not ' state]);
            result = true;
        end

        function set_scale(self, scale)
            % Ratio of the slave's motion to the master's, above 0.
            self.command('set_scale', scale);
        end

        function scale = get_scale(self)
            % The same.
            row = self.state();
            scale = row.scale;
        end

        function lock_rotation(self, on)
            % The slave's orientation stays as it is.
            self.command('lock_rotation', trocar.internal.flag(on));
        end

        function lock_translation(self, on)
            % The slave's position stays as it is.
            self.command('lock_translation', trocar.internal.flag(on));
        end

        function set_align_mtm(self, on)
            % Turn the master as the slave is before following.
            self.command('set_align_MTM', trocar.internal.flag(on));
        end

    end

end
