classdef joints < trocar.measured
    % Where joints are, and what their controller was last given.

    methods

        function self = joints(bridge, path)
            % As measured.
            self@trocar.measured(bridge, path);
        end

        function [jp, jv, jf, timestamp] = setpoint_js(self)
            % Positions, velocities and efforts that they were given.
            [jp, jv, jf, timestamp] = self.joints_of.joint_state([self.joints_path 'setpoint_js']);
        end

        function [jp, timestamp] = setpoint_jp(self)
            % Positions.
            [jp, ~, ~, timestamp] = self.setpoint_js();
        end

        function [jv, timestamp] = setpoint_jv(self)
            % Velocities.
            [~, jv, ~, timestamp] = self.setpoint_js();
        end

        function [jf, timestamp] = setpoint_jf(self)
            % Efforts.
            [~, ~, jf, timestamp] = self.setpoint_js();
        end

    end

end
